"""Joints are placed by those that are seen as the distribution of postures has them."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.lab.calibration.body_model import HIDDEN, hidden_joints
from hri_predict.people.body import body_model as module
from hri_predict.people.body.body_model import BodyModel, body_model
from hri_predict.people.body.inferred import Inference
from hri_predict.people.body.seated import is_low
from hri_sim.people.body import Body

COUNT = len(JOINTS)
_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([0.8, 0.3]), 0.4))
ALL = np.ones(COUNT, bool)
LEGS = np.isin(JOINTS, [f"{s}_{j}" for s in "lr" for j in ("knee", "ankle", "foot")])
TRUNK = ("waist", "torso", "neck", "head", "l_shoulder", "r_shoulder", "l_hip", "r_hip")
SWAP = np.arange(COUNT)
for _left, _right in CANONICAL.left_right_pairs:
    SWAP[[_left, _right]] = _right, _left
SETS = st.sampled_from([~hidden_joints(names) for names in HIDDEN.values()])


def of(*names):
    return np.isin(JOINTS, names)


def turned(body, angle, shift=(0.0, 0.0, 0.0)):
    cosine, sine = np.cos(angle), np.sin(angle)
    return body @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]) + shift


def trembling(seed, size=0.03):
    return BODY + np.random.default_rng(seed).normal(0.0, size, BODY.shape)


def any_model(seed):
    """Any distribution about a standing body that faces x."""
    rng = np.random.default_rng(seed)
    spread = rng.normal(0.0, 0.05, (3 * COUNT, 3 * COUNT))
    mean = _WHO.joints(_WHO.standing(np.zeros(2), 0.0)) + rng.normal(0.0, 0.02, (COUNT, 3))
    return BodyModel(mean, spread @ spread.T + 1e-4 * np.eye(3 * COUNT), rng.uniform(1, 3, COUNT))


def conditioned(model, body, seen):
    """Places and radii by Bishop, eq. 2.81 and 2.82, in a heading frame of its own making; the
    scale by Ding (2016)."""
    at = dict(zip(JOINTS, body, strict=True))
    across = np.zeros(2)
    for part in ("shoulder", "hip"):
        if seen[of(f"l_{part}", f"r_{part}")].all():
            span = (at[f"l_{part}"] - at[f"r_{part}"])[:2]
            width = np.linalg.norm(span)
            across += span / width if width > module.LEAST_WIDTH_M else 0.0
    heading = np.arctan2(across[1], across[0]) - np.pi / 2
    origin = body[seen & of(*TRUNK)].mean(0) * [1, 1, 0]
    own = turned(body - origin, -heading)
    covariance = model.covariance.copy()
    for axis, deviation in enumerate((module.ORIGIN_M, module.ORIGIN_M, module.FLOOR_M)):
        moves_along = np.arange(3 * COUNT) % 3 == axis
        covariance += deviation**2 * np.outer(moves_along, moves_along)
    known = np.repeat(seen, 3)
    noise = module.NOISE_M**2 * np.eye(known.sum())
    across_sets = covariance[:, known]
    inverse = np.linalg.inv(covariance[np.ix_(known, known)] + noise)
    off = own.reshape(-1)[known] - model.mean.reshape(-1)[known]
    place = (model.mean.reshape(-1) + across_sets @ inverse @ off).reshape(-1, 3)
    left = covariance - across_sets @ inverse @ across_sets.T
    variance = [np.trace(left[i : i + 3, i : i + 3]) for i in range(0, len(left), 3)]
    growth = np.sqrt((module.TAIL + off @ inverse @ off) / (module.TAIL + known.sum()))
    within = max(growth, module.LEAST_GROWTH) * model.factor * np.sqrt(variance)
    return turned(place, heading) + origin, within


# -- conditioning ------------------------------------------------------------------------------


@given(seed=st.integers(0, 10_000), seen=SETS, angle=st.floats(-np.pi, np.pi))
def test_places_and_radii_are_those_of_the_conditioned_distribution(seed, seen, angle):
    model = any_model(seed)
    body = turned(trembling(seed), angle, (3.0, -2.0, 0.0))
    found = model.complete(body[None], seen[None])
    place, within = conditioned(model, body, seen)
    assert found.usable.all()
    # a covariance of condition 1e6, in metres
    np.testing.assert_allclose(found.positions[0], place, atol=1e-8)
    np.testing.assert_allclose(found.within_m[0], within, rtol=1e-6)


def test_the_places_are_those_of_samples_that_have_the_seen_joints_there(monkeypatch):
    """Of samples of a normal distribution, the places of two hidden hands follow as is stated."""
    monkeypatch.setattr(module, "TAIL", 1e12)
    model = body_model()
    rng = np.random.default_rng(3)
    flat = rng.multivariate_normal(model.mean.reshape(-1), model.covariance, 4000)
    bodies, seen = flat.reshape(-1, COUNT, 3), ~hidden_joints(HIDDEN["hands"])
    found = model.complete(bodies, np.broadcast_to(seen, bodies.shape[:2]))
    off = np.linalg.norm(found.positions - bodies, axis=-1)[found.usable][:, ~seen]
    deviation = (found.within_m[0] / model.factor)[~seen]
    # 4000 samples, and the seen joints have no noise, for which 2 cm are allowed
    np.testing.assert_allclose(np.sqrt((off**2).mean(0)), deviation, rtol=0.1)


@given(
    seen=SETS,
    angle=st.floats(-np.pi, np.pi),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    seed=st.integers(0, 10_000),
)
def test_turning_and_moving_over_the_floor_changes_nothing(seen, angle, shift, seed):
    body = trembling(seed)
    moved = turned(body, angle, (*shift, 0.0))
    here = body_model().complete(body[None], seen[None])
    there = body_model().complete(moved[None], seen[None])
    np.testing.assert_array_equal(here.usable, there.usable)
    # 1e-14 of 50 m, by gains of up to some hundred
    np.testing.assert_allclose(
        there.positions[0], turned(here.positions[0], angle, (*shift, 0.0)), atol=1e-9
    )
    np.testing.assert_allclose(here.within_m, there.within_m, rtol=1e-6)


@given(seen=SETS, seed=st.integers(0, 10_000))
def test_left_and_right_are_completed_alike(seen, seed):
    body = trembling(seed)
    mirrored, mirrored_seen = body[SWAP] * [1, -1, 1], seen[SWAP]
    here = body_model().complete(body[None], seen[None])
    there = body_model().complete(mirrored[None], mirrored_seen[None])
    np.testing.assert_array_equal(here.usable, there.usable)
    # the file's numbers are rounded to five digits
    np.testing.assert_allclose(there.positions[0], here.positions[0][SWAP] * [1, -1, 1], atol=0.002)
    np.testing.assert_allclose(there.within_m[0], here.within_m[0][SWAP], atol=0.002)


def test_bodies_together_are_as_one_by_one():
    rng = np.random.default_rng(5)
    bodies = np.array([trembling(seed) for seed in range(30)])
    seen = rng.random(bodies.shape[:2]) < 0.7
    together = body_model().complete(bodies, seen)
    assert 0 < together.usable.sum() < 30
    for i in range(30):
        alone = body_model().complete(bodies[i : i + 1], seen[i : i + 1])
        for one, all_of_them in zip(alone, together, strict=True):
            np.testing.assert_allclose(one[0], all_of_them[i], atol=1e-12)


@given(more=st.integers(0, COUNT - 1), seen=SETS)
def test_a_joint_more_makes_no_other_of_the_mean_posture_less_certain(more, seen):
    body, with_it = body_model().mean[None], seen.copy()
    with_it[more] = True
    less, known = (body_model().complete(body, s[None]).within_m for s in (seen, with_it))
    assert (known <= less + 1e-9).all()


@given(seen=SETS)
def test_the_odder_the_posture_the_larger_the_radii(seen):
    mean = body_model().mean
    arms_up = mean + np.isin(JOINTS, ["l_hand", "l_wrist", "l_elbow"])[:, None] * [0, 0, 0.7]
    for size in (0.5, 1.0):
        body = (1 - size) * mean + size * arms_up
        less, more = (body_model().complete(b[None], seen[None]) for b in (mean, body))
        assert (more.within_m >= less.within_m - 1e-9).all()
    if seen[of("l_elbow", "l_wrist")].all():
        assert (more.within_m[0, ~seen] > 1.02 * less.within_m[0, ~seen]).all()


# -- what is completed -------------------------------------------------------------------------


@given(seed=st.integers(0, 10_000), seen=SETS)
def test_a_joint_that_is_seen_is_never_moved(seed, seen):
    body = trembling(seed)
    filled = Inference(body_model()).fill(np.where(seen[:, None], body, 0.0), seen)
    np.testing.assert_array_equal(filled.positions[seen], body[seen])
    assert (filled.within_m[seen] == 0).all()
    assert (filled.within_m[filled.observed & ~seen] > 0).all()
    low = is_low(body[None], seen[None])[0]  # trembling by 3 cm may look like that
    assert filled.observed[~LEGS if low else ALL].all()


@pytest.mark.parametrize(
    "names",
    [
        ("l_shoulder", "r_shoulder", "neck"),  # three joints
        ("head", "neck", "torso", "waist", "l_shoulder", "l_elbow", "l_wrist", "l_hip"),  # no pair
        ("l_elbow", "l_wrist", "l_hand", "r_elbow", "r_wrist", "r_hand"),  # no trunk
        ("l_wrist",),
        (),
    ],
)
def test_of_a_body_of_which_little_is_seen_nothing_is_completed(names):
    seen = of(*names)
    assert not body_model().complete(BODY[None], seen[None]).usable.any()
    filled = Inference(body_model()).fill(BODY, seen)
    by_rules = Inference().fill(BODY, seen)
    np.testing.assert_array_equal(filled.observed, by_rules.observed)
    np.testing.assert_array_equal(filled.within_m, by_rules.within_m)


def lying(roll):
    """On the floor: on the back, on the face, on a side."""
    body = _WHO.joints(_WHO.standing(np.zeros(2), 0.0))
    upright = turned(body, roll) @ np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    upright[:, 2] += 0.1 - upright[:, 2].min()
    return upright


@pytest.mark.parametrize("roll", np.radians([0, 90, 180, 270]))
@pytest.mark.parametrize("hidden", ["hands", "forearms", "feet", "legs below the hips"])
def test_a_body_that_lies_is_not_completed(roll, hidden):
    seen = ~hidden_joints(HIDDEN[hidden])
    assert not body_model().complete(lying(roll)[None], seen[None]).usable.any()


def test_a_body_whose_parts_are_torn_apart_is_not_completed():
    torn = trembling(1, size=1.0)
    seen = ~hidden_joints(HIDDEN["feet"])
    assert not body_model().complete(torn[None], seen[None]).usable.any()


def test_the_floor_is_where_the_room_has_it():
    seen, up = ~hidden_joints(HIDDEN["legs below the hips"]), np.array([0, 0, 0.7])
    here = Inference(body_model()).fill(BODY, seen)
    there = Inference(body_model(), floor_m=0.7).fill(BODY + up, seen)
    np.testing.assert_array_equal(here.observed, there.observed)
    np.testing.assert_allclose(there.positions, here.positions + up, atol=1e-9)


# -- the file ----------------------------------------------------------------------------------


def test_the_shipped_model_is_a_distribution_of_bodies():
    model = body_model()
    assert np.linalg.eigvalsh(model.covariance).min() > 0
    np.testing.assert_array_equal(model.covariance, model.covariance.T)
    assert (model.factor > 0.5).all()
    assert np.isfinite(model.most_odd)
    # left is left: a body of the mean posture, and its mirror image
    np.testing.assert_allclose(model.mean[SWAP] * [1, -1, 1], model.mean, atol=0.002)
    assert model.mean[JOINTS.index("head"), 2] > 1.3
    assert model.mean[JOINTS.index("l_hip"), 1] > model.mean[JOINTS.index("r_hip"), 1]


def test_the_file_is_what_the_model_writes():
    written = body_model().to_json()
    assert written == json.loads(module.FILE.read_text(encoding="utf-8"))


def read(tmp_path, monkeypatch, text):
    path = tmp_path / "body_model.json"
    path.write_text(text, encoding="utf-8")
    monkeypatch.setattr(module, "FILE", path)
    return body_model.__wrapped__


@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: "",
        lambda whole: json.dumps(whole)[:1000],
        lambda whole: "[]",
        lambda whole: json.dumps(whole | {"joints": whole["joints"][1:]}),
        lambda whole: json.dumps({k: v for k, v in whole.items() if k != "factor"}),
        lambda whole: json.dumps(whole | {"mean_m": whole["mean_m"][1:]}),
        lambda whole: json.dumps(whole | {"mean_m": "?"}),
        lambda whole: json.dumps(whole | {"factor": [1.0]}),
        lambda whole: json.dumps(whole | {"factor": [float("nan")] * COUNT}),
        lambda whole: json.dumps(whole | {"covariance_m2": whole["covariance_m2"][:-1]}),
        lambda whole: json.dumps(
            whole | {"covariance_m2": [[-1.0] * (i + 1) for i in range(3 * COUNT)]}
        ),
    ],
    ids=[
        "empty", "cut", "list", "other skeleton", "no factor", "mean too short", "mean no number",
        "one factor", "factor not finite", "covariance cut", "not positive",
    ],
)  # fmt: skip
def test_a_damaged_file_is_named_in_one_line(tmp_path, monkeypatch, damage):
    whole = json.loads(module.FILE.read_text(encoding="utf-8"))
    with pytest.raises(ConfigError, match=r"body_model\.json: .*install hri-predict again") as told:
        read(tmp_path, monkeypatch, damage(whole))()
    assert "\n" not in str(told.value)


def test_a_missing_file_is_named_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "FILE", tmp_path / "body_model.json")
    with pytest.raises(ConfigError, match=r"body_model\.json") as told:
        body_model.__wrapped__()
    assert "\n" not in str(told.value)
