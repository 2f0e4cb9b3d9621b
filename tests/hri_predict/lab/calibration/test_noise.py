"""Growth of radii with noise: what noisy recordings need, and nothing where they need nothing."""

from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.lab.calibration.depth_tracker import DepthTracker
from hri_predict.lab.calibration.noise import SECONDS, as_recorded, scores_seen, with_noise
from hri_predict.lab.calibration.presence import Presence
from hri_predict.lab.calibration.scores import evidence_of
from hri_predict.predictors.baselines import ZeroVelocity, ZeroVelocitySettings
from hri_predict.zones.input_noise import MOST_GROWTH, NoiseGrowth, input_noise_m
from hri_predict.zones.radii import Radii
from hri_predict.zones.settings import LEVELS, CoverageSettings
from tests.hri_predict.zones.conftest import calibration_of

BODY = np.random.default_rng(3).uniform(-0.5, 0.5, (len(JOINTS), 3)) + np.array([0.0, 0.0, 1.0])
PREDICTOR = ZeroVelocity(ZeroVelocitySettings(name="zero_velocity", horizon_s=0.4))


def scored(make_recording, see, count=6, seed=0):
    """People who sway by 2 cm, each in a phase of their own."""
    found = []
    for k in range(count):
        t = np.arange(250) / 25.0
        sway = 0.02 * np.sin(2 * np.pi * (0.5 * t + k / count))
        positions = BODY + sway[:, None, None] * np.array([1.0, 0.0, 0.0])
        recording = make_recording(positions, name=f"sways_{k}")
        found += scores_seen(PREDICTOR, [recording], see, seed=seed)
    return found


@pytest.fixture(scope="module")
def clean(make_recording):
    return scored(make_recording, as_recorded)


@pytest.fixture(scope="module")
def noisy(make_recording):
    return scored(make_recording, DepthTracker(strength=2.0).seen, seed=1)


def calibration(factor):
    """Radii that are the same for every joint and level, by step."""
    made = calibration_of(steps=10)
    tables = {of: np.full_like(t, factor) for of, t in made.estimated.items()}
    return replace(made, estimated=tables)


def held(made, scores, level, of):
    """(H,) the share of joints, or bodies, within their radii where there is noise."""
    radii = Radii(made, CoverageSettings(level=level, of=of), CANONICAL, 10)
    shares = []
    for entry in scores:
        noise = input_noise_m(entry.history, entry.observed, CANONICAL)
        radius = radii.of(entry.speed_m_s, evidence_of(entry))
        inside = entry.error_m <= radius
        known = np.isfinite(entry.error_m)
        if of == "body":
            inside, known = (inside | ~known).all(2)[..., None], known.any(2)[..., None]
        some = noise > 1e-4
        shares.append([(inside & known)[some].sum((0, 2)), known[some].sum((0, 2))])
    hits, count = np.sum(shares, axis=0)
    return hits / np.maximum(count, 1)


@pytest.mark.parametrize("of", ["joint", "body"])
@pytest.mark.long
def test_noisy_people_are_held_as_often_as_stated(clean, noisy, of):
    small = calibration(0.05)
    made = with_noise(small, clean=clean, noisy=noisy, skeleton=CANONICAL)
    for level in LEVELS:
        before, after = held(small, noisy, level, of), held(made, noisy, level, of)
        assert before[-1] < level  # the case is one
        assert (after >= level - 0.01).all()  # every third window was fitted
        assert np.allclose(
            held(made, clean, level, of), held(small, clean, level, of), 0, 1e-12, True
        )


def test_radii_that_hold_noise_already_do_not_grow(clean, noisy):
    made = with_noise(calibration(10.0), clean=clean, noisy=noisy, skeleton=CANONICAL)
    assert made.noise is not None
    assert all((table == 0).all() for table in made.noise.table.values())


def test_the_growth_is_that_of_the_radii_without_one(clean, noisy):
    made = with_noise(calibration(0.05), clean=clean, noisy=noisy, skeleton=CANONICAL)
    again = with_noise(made, clean=clean, noisy=noisy, skeleton=CANONICAL)
    assert made.noise is not None
    assert again.noise is not None
    for of, table in made.noise.table.items():
        assert np.array_equal(table, again.noise.table[of])
        assert (table > 0).any()
        assert (table <= MOST_GROWTH).all()
        assert (np.diff(table, axis=0) >= 0).all()
        assert (np.diff(table, axis=1) >= 0).all()


@pytest.mark.parametrize(
    ("usable", "delivered", "said"),
    [
        (3, 6, r"^--data: too few recordings \(3\): .*; give 4 at least$"),
        (6, 3, r"^--data: too few recordings \(3\) show a tracker's noise: .*; give 4 at least"),
        (0, 0, r"^--data: too few recordings \(0\): "),
    ],
)
def test_too_few_recordings_are_refused(clean, noisy, usable, delivered, said):
    some = {"clean": clean[:usable], "noisy": noisy[:delivered]}
    with pytest.raises(ConfigError, match=said):
        with_noise(calibration(0.05), **some, skeleton=CANONICAL)


def test_recordings_without_noise_are_too_few(clean):
    with pytest.raises(ConfigError, match=r"too few recordings \(0\) show a tracker's noise"):
        with_noise(calibration(0.05), clean=clean, noisy=clean, skeleton=CANONICAL)


def short(scores):
    """The same windows, whose recordings end before the last step, except for three."""
    found = []
    for k, entry in enumerate(scores):
        error = entry.error_m.copy()
        error[:, -1] = np.nan if k >= 3 else error[:, -1]
        found.append(replace(entry, error_m=error))
    return found


def test_a_step_of_too_few_recordings_keeps_the_growth_that_it_had(clean, noisy):
    small = calibration(0.05)
    with pytest.raises(ConfigError, match=r"too few recordings \(3\) .* step 10 of 10; give 4"):
        with_noise(small, clean=clean, noisy=short(noisy), skeleton=CANONICAL)
    tables = {of: np.full((len(LEVELS), 10), 500.0) for of in small.estimated}
    old = replace(small, noise=NoiseGrowth(tables))
    made = with_noise(old, clean=clean, noisy=short(noisy), skeleton=CANONICAL)
    assert made.noise is not None
    for table in made.noise.table.values():
        assert (table[:, -1] == 500.0).all()
        assert (table[:, 0] < 500.0).all()  # measured again


def test_the_begin_of_a_presence_is_scored_and_each_has_its_own_noise(make_recording):
    stamps = []

    def see(presence: Presence, seed: int) -> Presence:
        stamps.append((presence.stamps_ns[-1] * 1e-9, seed))
        return as_recorded(presence, seed)

    scored(make_recording, see, count=2)
    assert [end for end, _ in stamps] == pytest.approx([SECONDS, SECONDS])
    assert stamps[0][1] != stamps[1][1]
