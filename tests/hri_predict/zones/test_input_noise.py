"""A tracker's noise is measured by bones, and zones grow with it; without it nothing changes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import hri_predict
from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.zones.calibration import load_calibration, save_text
from hri_predict.zones.input_noise import BONES, MOST_M, NoiseGrowth, input_noise_m
from hri_predict.zones.learned_scale import Evidence
from hri_predict.zones.radii import Radii
from hri_predict.zones.settings import CoverageSettings

COUNT, STEPS = len(JOINTS), 25
UNIT = np.random.default_rng(5).normal(size=(COUNT, 3))
"""Places of joints, about a metre apart: any lengths of bones will do."""
GROWTH = NoiseGrowth(
    {
        "joint": np.array([[2.0, 3.0, 4.0], [4.0, 6.0, 8.0], [8.0, 12.0, 16.0]]),
        "body": np.array([[3.0, 4.0, 5.0], [5.0, 7.0, 9.0], [9.0, 13.0, 17.0]]),
    }
)


def walking(people=1):
    """A rigid body that turns and moves: bones keep their lengths."""
    angle = np.linspace(0.0, 1.0, STEPS)
    turn = np.zeros((STEPS, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1] = np.sin(angle), -np.sin(angle)
    turn[:, 2, 2] = 1.0
    path = np.einsum("tij,kj->tki", turn, UNIT) + np.linspace(0, 1.4, STEPS)[:, None, None]
    return np.repeat(path[None], people, axis=0)


def lasting(size_m, seed=0, lasts=10.0):
    """Errors (1, T, J, 3) whose correlation falls by 1/e in some steps."""
    noise = np.random.default_rng(seed).normal(size=(1, STEPS, COUNT, 3))
    kept = np.exp(-1 / lasts)
    for t in range(1, STEPS):
        noise[:, t] = kept * noise[:, t - 1] + np.sqrt(1 - kept**2) * noise[:, t]
    return size_m * noise


def measured(history, seen=None):
    seen = np.ones(history.shape[:3], bool) if seen is None else seen
    return input_noise_m(history, seen, CANONICAL)


def evidence(history, **changes):
    people = len(history)
    known = Evidence(
        history=history,
        observed=np.ones(history.shape[:3], bool),
        forecast=np.repeat(history[:, -1:], 3, axis=1),
        error_m=np.zeros((people, 2, COUNT)),
        residual_m=np.zeros(people),
    )
    return replace(known, **changes)


# -- the measure ---------------------------------------------------------------------------------


def test_a_body_whose_bones_keep_their_length_has_no_noise_however_it_moves():
    assert measured(walking()) == 0.0
    assert measured(walking() + lasting(0.001)) == 0.0  # markers: below the floor


def test_errors_that_last_are_measured_in_metres():
    """Of two joints' errors, bones show the part along them, less what a second hides of it."""
    found = np.array([measured(walking() + lasting(0.03, seed))[0] for seed in range(20)])
    assert (found > 0).all()
    assert 0.008 < np.median(found) < 0.03
    small = np.array([measured(walking() + lasting(0.01, seed))[0] for seed in range(20)])
    assert np.median(small) < np.median(found) / 2


def test_white_noise_is_left_to_the_learned_scale():
    def half(make):
        return np.median([measured(walking() + make(seed))[0] for seed in range(20)])

    def white(seed):
        return np.random.default_rng(seed).normal(0, 0.02, (1, STEPS, COUNT, 3))

    assert half(white) < 0.25 * half(lambda seed: lasting(0.02, seed))


def test_one_bad_bone_or_a_burst_does_not_decide():
    history = walking()
    history[:, :, JOINTS.index("l_wrist")] += lasting(0.3)[:, :, 0]
    history[:, 10:13] += lasting(0.5)[:, 10:13]
    assert measured(history) == 0.0


def test_only_measured_bones_count_and_without_any_nothing_is_known():
    history = walking() + lasting(0.05)
    assert measured(history, np.zeros((1, STEPS, COUNT), bool)) == 0.0
    seen = np.ones((1, STEPS, COUNT), bool)
    seen[:, :, [JOINTS.index(f"{side}_{part}") for side in "lr" for part in ("knee", "elbow")]] = 0
    assert measured(history, seen) == 0.0  # each bone lacks an end
    assert measured(history[:, :4]) == 0.0  # too short to tell
    assert {name for bone in BONES for name in bone} <= set(JOINTS)


def test_people_are_measured_one_by_one():
    history = walking(3)
    history[1:2] += lasting(0.03)
    found = measured(history)
    assert found[0] == found[2] == 0.0
    assert found[1] == measured(history[1:2])[0] > 0


@given(st.floats(0.0, 1e3), st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
def test_any_input_gives_a_noise_within_its_bounds(size_m, seed, share):
    history = walking() + lasting(size_m, seed)
    seen = np.random.default_rng(seed).random((1, STEPS, COUNT)) < share
    history[~seen] = np.nan
    found = measured(history, seen)
    assert found.shape == (1,)
    assert 0.0 <= found[0] <= MOST_M


# -- the radii -----------------------------------------------------------------------------------


def radii_of(calibration, history, level=0.99, of="joint", **changes):
    settings = CoverageSettings(level=level, of=of)
    return Radii(calibration, settings, CANONICAL, 3).of(
        np.zeros(len(history)), evidence(history, **changes)
    )


def test_without_noise_radii_are_the_same_to_the_bit(make_calibration):
    made = make_calibration(steps=3)
    grows = replace(made, noise=GROWTH)
    assert np.array_equal(radii_of(grows, walking()), radii_of(made, walking()))
    assert np.array_equal(
        radii_of(grows, walking() + lasting(0.001)), radii_of(made, walking() + lasting(0.001))
    )


def test_noise_grows_radii_by_level_question_and_step(make_calibration):
    made = make_calibration(steps=3)
    grows = replace(made, noise=GROWTH)
    history = walking() + lasting(0.03)
    noise = measured(history)[0]
    assert noise > 0
    for level, row in ((0.9, 0), (0.95, 1), (0.99, 2)):
        for of in ("joint", "body"):
            before = radii_of(made, history, level, of)
            after = radii_of(grows, history, level, of)
            growth = GROWTH.table[of][row][None, :, None]
            assert after == pytest.approx(np.sqrt(before**2 + (growth * noise) ** 2))


def test_inferred_joints_do_not_count_as_noise(make_calibration):
    grows = replace(make_calibration(steps=3), noise=GROWTH)
    history = walking() + lasting(0.05)
    none = np.zeros((1, STEPS, COUNT), bool)
    assert (radii_of(grows, history) > radii_of(grows, history, measured=none)).all()


def test_guaranteed_radii_rest_on_no_measure(make_calibration):
    made = make_calibration(steps=3)
    settings = CoverageSettings(level=0.9, of="joint", basis="guaranteed")
    known = evidence(walking() + lasting(0.05))
    without, grows = (
        Radii(c, settings, CANONICAL, 3).of(np.zeros(1), known)
        for c in (made, replace(made, noise=GROWTH))
    )
    assert np.array_equal(without, grows)


@given(st.floats(0.0, 10.0), st.integers(0, 2**32 - 1))
def test_radii_never_shrink_by_noise_and_stay_bounded(make_calibration, size_m, seed):
    made = make_calibration(steps=3)
    history = walking() + lasting(size_m, seed)
    before = radii_of(made, history)
    after = radii_of(replace(made, noise=GROWTH), history)
    assert (after >= before).all()
    assert (after <= np.hypot(before, MOST_M * 16.0) + 1e-12).all()
    assert (np.diff(after, axis=1) >= 0).all()


# -- files ---------------------------------------------------------------------------------------


def test_the_growth_survives_the_file(tmp_path, make_calibration):
    path = tmp_path / "own.calibration.json"
    path.write_text(save_text(replace(make_calibration(steps=3), noise=GROWTH)))
    found = load_calibration(path).noise
    assert found is not None
    for of, rows in GROWTH.table.items():
        assert found.table[of] == pytest.approx(rows)
    path.write_text(save_text(make_calibration(steps=3)))
    assert load_calibration(path).noise is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda table: table.pop("body"), "joint and body"),
        (lambda table: table["joint"].pop(), "shape"),
        (lambda table: table["joint"][0].append(1), "not a table"),
        (lambda table: table["joint"][0].__setitem__(0, -1), "between 0 and"),
        (lambda table: table["joint"][2].__setitem__(2, 10**9), "between 0 and"),
        (lambda table: table["joint"][0].__setitem__(1, 0), "not decrease"),
        (lambda table: table["body"][1].__setitem__(0, 0), "not decrease"),
        (lambda table: table["body"][1].__setitem__(0, "x"), "not a table"),
        (lambda table: table["body"][1].__setitem__(0, None), "between 0 and"),
    ],
)
def test_a_growth_that_cannot_be_is_refused(tmp_path, make_calibration, change, said):

    data = json.loads(save_text(replace(make_calibration(steps=3), noise=GROWTH)))
    change(data["noise"])
    path = tmp_path / "own.calibration.json"
    path.write_text(json.dumps(data))
    with pytest.raises(ConfigError, match=said):
        load_calibration(path)


def test_in_an_empty_room_there_is_no_noise():
    assert measured(walking()[:0]).shape == (0,)


@pytest.mark.parametrize("name", ["average", "sinn"])
def test_the_default_predictor_and_its_rival_grow_with_tracker_noise_and_know_directions(name):
    """A new default once shipped without growth, so noisy trackers got the zones of clean ones."""
    made = hri_predict.load_calibration_of(name)
    assert made is not None
    assert made.noise is not None
    assert made.toward is not None
