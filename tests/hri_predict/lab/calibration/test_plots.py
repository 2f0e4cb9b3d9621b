"""Pictures of zones show what was measured, and leave out what was not."""

import numpy as np
import pytest

from hri_predict.lab.calibration.coverage import Calibrated
from hri_predict.zones.settings import CoverageSettings

pytest.importorskip("matplotlib")

from PIL import Image

from hri_predict.base.skeleton import JOINTS
from hri_predict.lab.calibration.coverage import Coverage
from hri_predict.lab.calibration.judgement import WAYS, ZoneJudgement
from hri_predict.lab.calibration.plots import (
    radii,
    radius_by_step,
    reliability,
    write_pictures,
)
from hri_predict.lab.calibration.scores import score_recordings
from hri_predict.predictors.baselines import ZeroVelocity, ZeroVelocitySettings
from hri_predict.zones.calibration import OFS, Calibration, UsedRecording, plain
from hri_predict.zones.motion_class import SPEED_CLASSES
from hri_predict.zones.settings import LEVELS, HumanLimits
from tests.hri_predict.zones.conftest import scale_of

RATE_HZ, STEPS = 25.0, 25
QUESTIONS: tuple[str, ...] = ("joint", "body")
PLAIN = tuple(dict.fromkeys(plain(name) for name in JOINTS))
ALL = tuple(range(len(SPEED_CLASSES)))
BODY = np.random.default_rng(4).normal(size=(len(JOINTS), 3))


def coverage_of(held, known, actions=("walking",)):
    none = np.zeros(len(held))
    names = tuple(f"walking_{u}" for u in range(len(held)))
    return Coverage(
        names=names,
        actions=actions * (len(held) // len(actions)),
        held=dict.fromkeys(QUESTIONS, held),
        known=dict.fromkeys(QUESTIONS, known),
        windows=none + 100,
        widened_in=none,
        unlike_in=none,
    )


def covered(share, units=3, steps=STEPS):
    """Of 100 joints in each recording at each step that share is inside."""
    known = np.full((units, steps), 100.0)
    return coverage_of(known * share, known)


def calibrated(scale=0.01, classes=ALL):
    """Radii of speed class c at step k: scale (c + 1) (k + 1) metres; infinite in others."""
    table = np.full((len(LEVELS), len(SPEED_CLASSES), STEPS), np.inf)
    for c in classes:
        table[:, c] = scale * (c + 1) * np.arange(1, STEPS + 1)
    guaranteed = np.full((len(LEVELS), len(SPEED_CLASSES), len(PLAIN), STEPS), np.inf)
    return Calibration(
        predictor="zero_velocity",
        settings={},
        weights=None,
        rate_hz=RATE_HZ,
        joints=PLAIN,
        scale=scale_of(),
        estimated=dict.fromkeys(OFS, table),
        guaranteed=dict.fromkeys(OFS, guaranteed),
        recordings=(UsedRecording(name="walking_1", windows=(9,) * len(SPEED_CLASSES)),),
        ranges={"speed_m_s": {}, "ratio_short": 1.0},
    )


def predictor():
    return ZeroVelocity(ZeroVelocitySettings(name="zero_velocity", horizon_s=1.0))


def marks(axes, marker):
    """(x, y) of all marks of a kind that have a place."""
    found = [line.get_xydata() for line in axes.lines if line.get_marker() == marker]
    return np.concatenate([xy for xy in found if len(xy)] or [np.zeros((0, 2))])


def sane(path):
    """A PNG as a README shows it."""
    with Image.open(path) as image:
        assert image.format == "PNG"
        assert 1500 <= image.width <= 2000
        assert 700 <= image.height <= 2000
    return path.stat().st_size < 300_000


# -- coverage ---------------------------------------------------------------------------------


def test_every_measured_coverage_is_a_mark_at_its_level_and_horizon():
    shares = {0.9: 0.91, 0.95: 0.945, 0.99: 0.993}
    coverage = {
        (level, of, way): covered(shares[level] - 0.01 * (of == "body"))
        for level in LEVELS
        for of in QUESTIONS
        for way in WAYS
    }
    joint, body = reliability(coverage, "kalman", RATE_HZ).axes[:2]
    circles = marks(joint, "o")  # as calibrated: left of the middle of each of three horizons
    assert np.round(circles[:, 0]) == pytest.approx(range(9))
    assert circles[:, 1] == pytest.approx(np.repeat([0.91, 0.945, 0.993], 3))
    assert marks(body, "s")[:, 1] == pytest.approx(np.repeat([0.90, 0.935, 0.983], 3))
    low, high = joint.get_ylim()
    assert low < 0.89
    assert high > 0.999


def test_an_interval_shows_how_unlike_recordings_are():
    held = np.array([[80.0] * STEPS, [100.0] * STEPS])
    unlike = coverage_of(held, np.full((2, STEPS), 100.0), ("a", "b"))
    axes = reliability({(0.9, "joint", WAYS[0]): unlike}, "kalman", RATE_HZ).axes[0]
    ends = marks(axes, "_")[:, 1].reshape(-1, 2)
    assert ends == pytest.approx(np.array([[0.8, 0.9995]] * 3))  # 100 % is drawn at the top


def test_no_mark_where_nothing_is_known_or_beyond_the_horizon():
    short = covered(0.93, steps=12)  # 480 ms
    short.known["joint"][:, 4] = 0  # 200 ms
    axes = reliability({(0.9, "joint", WAYS[0]): short}, "kalman", RATE_HZ).axes[0]
    assert np.round(marks(axes, "o")[:, 0]) == pytest.approx([1])  # 400 ms alone


def test_one_recording_has_no_interval():
    coverage = {(0.99, "body", WAYS[2]): covered(0.97, units=1)}
    figure = reliability(coverage, "kalman", RATE_HZ)
    told = " ".join(text.get_text() for text in figure.legends[0].get_texts())
    assert "interval" not in told
    ends = marks(figure.axes[1], "_")[:, 1].reshape(-1, 2)
    assert ends[:, 0] == pytest.approx(ends[:, 1])


def test_coverage_however_low_stays_in_the_picture():
    coverage = {(0.9, "joint", WAYS[0]): covered(0.4), (0.95, "joint", WAYS[0]): covered(0.0)}
    axes = reliability(coverage, "kalman", RATE_HZ).axes[0]
    assert axes.get_ylim()[0] <= marks(axes, "o")[:, 1].min()


# -- radii ------------------------------------------------------------------------------------


def standing(make_recording, seconds=4.0, name="walking_1"):
    positions = np.repeat(BODY[None], round(seconds * RATE_HZ), axis=0)
    return score_recordings(predictor(), [make_recording(positions, name=name)])


def test_radii_are_the_mean_and_the_range_over_windows(make_recording):
    (scores,) = standing(make_recording)  # nobody moves: still
    scores.speed_m_s[:10] = 0.5  # but for ten windows
    slow, still = 10, len(scores.speed_m_s) - 10
    low, mean, high = radius_by_step(
        calibrated(), [scores], "hand", CoverageSettings(level=0.99, of="body")
    )
    steps = np.arange(1, STEPS + 1)
    assert mean == pytest.approx((still * 0.01 + slow * 0.02) * steps / (still + slow))
    assert low == pytest.approx(0.01 * steps)
    assert high == pytest.approx(0.02 * steps)  # a tenth of the windows and more


def test_a_speed_without_radii_leaves_no_mean(make_recording):
    scores = standing(make_recording)
    bare = calibrated(classes=[1])
    found = radius_by_step(bare, scores, "hand", CoverageSettings(level=0.99, of="body"))
    assert np.isinf(found).all()
    none = radius_by_step(bare, [], "hand", CoverageSettings(level=0.99, of="body"))
    assert np.isnan(none).all()


def lines(axes):
    return {line.get_label(): line.get_xydata() for line in axes.lines}


def test_balls_and_limits_are_drawn_beside_the_radii(make_recording):
    methods = {"kalman": (calibrated(), standing(make_recording))}
    hand, _, trunk = radii(methods, "recordings", HumanLimits(), 0.99).axes
    found = lines(hand)
    assert found["ball growing at 1.6 m/s"][-1] == pytest.approx([1000, 1.6])
    # an arm within 1 s: min(15 m, 4.5 + 8.3 / 2); the trunk: min(10 m, 2 + 8.3 / 2)
    cut = "limits of what a body can do (the physical cut)"
    assert found[cut][-1] == pytest.approx([1000, 8.65])
    assert lines(trunk)[cut][-1] == pytest.approx([1000, 6.15])
    assert found["kalman, 99 % of whole body"][0, 0] == pytest.approx(40)


def test_radii_of_nothing_are_still_a_picture(make_recording):
    bare = calibrated(classes=[])
    figure = radii(
        {"a": (bare, standing(make_recording)), "b": (bare, [])}, "x", HumanLimits(), 0.9
    )
    assert "ball growing at 2 m/s" in lines(figure.axes[0])


# -- all of them ------------------------------------------------------------------------------


@pytest.mark.long
def test_every_picture_is_written(tmp_path, make_recording):
    scores = [s for n in (1, 2) for s in standing(make_recording, name=f"walking_{n}")]
    coverage = {(level, of, WAYS[2]): covered(level) for level in LEVELS for of in QUESTIONS}
    judged = ZoneJudgement(
        predictor="zero_velocity",
        calibration=calibrated(),
        rate_hz=RATE_HZ,
        coverage=coverage,
        sizes={},
    )
    beside = {"kalman": (scores, Calibrated(predictor(), calibrated(0.02)))}
    files = write_pictures(
        out=tmp_path, predictor=predictor(), scores=scores, judged=judged, beside=beside
    )
    assert [f.name for f in files] == [
        "zones_reliability.png",
        "zones_radii.png",
        "zones_filmstrip.png",
    ]
    assert all(sane(f) for f in files)


@pytest.mark.long
def test_no_filmstrip_of_windows_without_a_known_second(tmp_path, make_recording):
    scores = standing(make_recording, seconds=1.28)  # the first origin is at 0.28 s
    judged = ZoneJudgement(
        predictor="zero_velocity",
        calibration=calibrated(),
        rate_hz=RATE_HZ,
        coverage={(0.9, "body", WAYS[0]): covered(0.9)},
        sizes={},
    )
    files = write_pictures(
        out=tmp_path, predictor=predictor(), scores=scores, judged=judged, beside={}
    )
    assert [f.name for f in files] == ["zones_reliability.png", "zones_radii.png"]
