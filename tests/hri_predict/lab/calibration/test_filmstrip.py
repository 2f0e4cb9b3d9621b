"""The zones' filmstrip: windows chosen blindly, silhouettes that hold what they stand for."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.lab.calibration.coverage import Calibrated

pytest.importorskip("matplotlib")

from hri_predict.base.geometry import Capsules
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.lab.calibration.conformal import calibrate
from hri_predict.lab.calibration.filmstrip import zone_filmstrip
from hri_predict.lab.calibration.scene import (
    SHOWN_MS,
    Projection,
    middle_window,
    outside,
    robot_beside,
    views,
    zone_scene,
)
from hri_predict.lab.calibration.scores import score_recordings
from hri_predict.predictors.baselines import ConstantVelocity, ConstantVelocitySettings
from hri_predict.zones.predictor_identity import identity
from hri_predict.zones.settings import CoverageSettings

RATE_HZ = 25.0


def body():
    """(J, 3) somebody upright who faces +x, left hand at +y, feet on the floor."""
    low = ("foot", "ankle", "knee", "hip", "hand", "wrist", "elbow", "shoulder")
    at = np.zeros((len(JOINTS), 3))
    for j, name in enumerate(JOINTS):
        part = name.removeprefix("l_").removeprefix("r_")
        at[j, 1] = 0.2 if name.startswith("l_") else -0.2 if name.startswith("r_") else 0.0
        heights = dict(zip(low, (0.0, 0.1, 0.5, 0.9, 0.8, 0.9, 1.1, 1.4), strict=True))
        heights |= {"waist": 0.95, "torso": 1.2, "neck": 1.45, "head": 1.6, "head_top": 1.75}
        at[j, 2] = heights[part]
    return at


def walked(seconds, speed_m_s=1.2, seed=0):
    """(F, J, 3) that body on its way along +x, every joint trembling a little."""
    frames = round(seconds * RATE_HZ)
    positions = np.repeat(body()[None], frames, axis=0)
    positions[..., 0] += speed_m_s * np.arange(frames)[:, None] / RATE_HZ
    return positions + np.random.default_rng(seed).normal(0, 0.003, positions.shape)


def constant(horizon_s=1.0):
    return ConstantVelocity(ConstantVelocitySettings(name="constant_velocity", horizon_s=horizon_s))


@pytest.fixture(scope="module")
def scored(make_recording):
    """Scores of recordings that grow in length, the third being the longest."""
    lengths = (3.0, 4.0, 6.0, 5.0)
    found = [make_recording(walked(s, seed=i), name=f"walking_{i}") for i, s in enumerate(lengths)]
    return score_recordings(constant(), found)


def found_window(scores, action):
    found = middle_window(scores, action)
    assert found is not None
    return found


def calibration_of(scores, predictor):
    values, weights = identity(
        ConstantVelocitySettings(name="constant_velocity", horizon_s=predictor.horizon_steps / 25)
    )
    skeleton = predictor.skeleton
    return calibrate(
        scores=scores,
        predictor="constant_velocity",
        settings=values,
        weights=weights,
        rate_hz=predictor.rate_hz,
        skeleton=skeleton,
    )


@pytest.fixture(scope="module")
def scene(scored):
    entry, window = found_window(scored, "walking")
    return zone_scene(
        entry,
        window,
        Calibrated(constant(), calibration_of(scored, constant())),
        CoverageSettings(),
    )


# -- which window -----------------------------------------------------------------------------


def test_the_window_is_the_middle_of_the_longest_recording(scored):
    entry, window = found_window(scored, "walking")
    assert entry.name == "walking_2"
    # origins 0.28 s to 4.96 s, the last with a known second at 149 / 25 - 1: 118 windows
    assert window == 59
    assert entry.origin_ns[window] == pytest.approx((7 + 59) * 1e9 / RATE_HZ)


def test_no_forecast_bears_on_which_window(scored):
    blind = [
        replace(s, forecast=np.full_like(s.forecast, 9.0), error_m=np.full_like(s.error_m, np.nan))
        for s in scored
    ]
    entry, window = found_window(blind, "walking")
    assert (entry.name, window) == ("walking_2", 59)


def test_no_window_without_a_second_to_show(scored, make_recording):
    assert middle_window(scored, "jumping") is None
    assert middle_window([], "walking") is None
    # the first window's second ends at 1.28 s; 32 frames end at 1.24 s, 33 at 1.28 s
    for seconds, found in ((1.28, False), (1.32, True)):
        brief = score_recordings(constant(), [make_recording(walked(seconds), name="walking_9")])
        assert (middle_window(brief, "walking") is not None) == found


# -- what is shown ----------------------------------------------------------------------------


def test_a_scene_shows_truth_and_zones_of_the_same_moments(scene):
    assert scene.shown_ms == (0, 200, 400, 600, 1000)
    pelvis = JOINTS.index("waist")
    moved = scene.true[:, pelvis, 0] - scene.true[0, pelvis, 0]
    assert moved == pytest.approx([0, 0.24, 0.48, 0.72, 1.2], abs=0.02)  # 1.2 m/s
    assert scene.forecast[0] == pytest.approx(scene.true[0])
    radius = scene.zones.radius
    assert (np.diff(radius.min(axis=1)) >= 0).all()
    for k in range(5):  # 99 % zones of the very windows they are calibrated on
        for s, segment in enumerate(CANONICAL.segments):
            ends = np.stack([scene.zones.a[k, s], scene.zones.b[k, s]])
            apart = np.linalg.norm(scene.true[k, segment.joint_a] - ends, axis=-1).min()
            assert apart <= radius[k, s]


@pytest.mark.long
def test_moments_beyond_the_horizon_are_left_out(make_recording):
    short = constant(0.5)
    found = [make_recording(walked(4.0, seed=i), name=f"walking_{i}") for i in range(4)]
    scores = score_recordings(short, found)
    entry, window = found_window(scores, "walking")
    scene = zone_scene(
        entry, window, Calibrated(short, calibration_of(scores, short)), CoverageSettings()
    )
    assert scene.shown_ms == (0, 200, 400)
    figure = zone_filmstrip([scene], CANONICAL, "kalman", "99 %")
    told = [[text.get_text() for text in axes.texts] for axes in figure.axes]
    assert told[3:5] == [["beyond its horizon"]] * 2
    # 68 windows from 0.28 s to 2.96 s: window 34 begins at 1.64 s
    assert told[:3] == [["walking_0, 1.6 s", "1 m"], [], []]


def test_seen_from_the_right_and_from_above_ahead_is_to_the_right(scene):
    side, above = views(scene, CANONICAL)
    assert side.across == pytest.approx([1, 0, 0], abs=0.02)  # the body faces +x
    assert side.up == pytest.approx([0, 0, 1])
    assert above.up == pytest.approx([0, 1, 0], abs=0.02)
    feet = side.project(scene.true[:, JOINTS.index("l_foot")])
    assert feet[:, 1] == pytest.approx(0.0, abs=0.03)


def test_the_robot_stands_to_the_left_of_where_the_person_comes(scene):
    arm = robot_beside(scene, *views(scene, CANONICAL))
    there = scene.true[-1].mean(axis=0)
    base = arm.a[:, 0]
    assert base[0, :2] - there[:2] == pytest.approx([0.4, 1.25], abs=0.2)
    assert base == pytest.approx(np.repeat(base[:1], 5, axis=0))
    tool = arm.b[:, -1]
    assert (np.linalg.norm(np.diff(tool, axis=0), axis=-1) > 0.02).all()


# -- silhouettes ------------------------------------------------------------------------------

coordinates = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)
shares = st.floats(0, 1)


def a_view(angle, tilt):
    across = np.array([np.cos(angle), np.sin(angle), 0.0])
    up = np.array([-np.sin(angle) * np.cos(tilt), np.cos(angle) * np.cos(tilt), np.sin(tilt)])
    return Projection(np.array([0.3, -0.2, 0.1]), across, up)


def one(a, b, radius):
    return Capsules(a[None], b[None], np.array([radius]))


@given(
    coordinates, coordinates, st.floats(0, 2), shares, coordinates, shares,
    st.floats(0, 7), st.floats(0, 7),
)  # fmt: skip
def test_a_silhouette_holds_every_point_of_its_capsule(a, b, radius, part, way, far, angle, tilt):
    length = np.linalg.norm(way)
    off = way / length * far * radius if length > 1e-6 else 0.0 * way
    inside = a + part * (b - a) + off
    view = a_view(angle, tilt)
    assert outside(view.project(inside), view, one(a, b, radius)) <= 1e-9


@given(coordinates, coordinates, st.floats(0.01, 2), coordinates, st.floats(0, 7), st.floats(0, 7))
def test_a_silhouette_is_no_larger_than_its_capsule(a, b, radius, point, angle, tilt):
    view = a_view(angle, tilt)
    flat = view.project(point)
    axis = view.project(a + np.linspace(0, 1, 2001)[:, None] * (b - a))
    sampled = np.linalg.norm(axis - flat, axis=-1).min() - radius
    spacing = np.linalg.norm(b - a) / 2000
    found = outside(flat, view, one(a, b, radius))
    assert sampled - spacing - 1e-9 <= found <= sampled + 1e-9


@given(coordinates, coordinates, st.floats(0.01, 2), st.floats(0, 1), coordinates)
def test_silhouettes_of_more_and_larger_capsules_hold_more(a, b, radius, more, point):
    view = a_view(0.4, 0.7)
    flat = view.project(point)
    small = outside(flat, view, one(a, b, radius))
    both = Capsules(np.stack([a, b]), np.stack([b, -a]), np.array([radius + more, 0.1]))
    assert outside(flat, view, both) <= small - more + 1e-9


def test_a_silhouette_by_hand():
    # seen along z, a capsule from (0, 0) to (2, 0) of radius 0.5: a point 3 m up is 2.5 m off,
    # one at (5, 4) is at a distance of sqrt(9 + 16) - 0.5 from its end, one on it 0.5 m inside
    view = Projection(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    capsule = one(np.array([0.0, 0, 7]), np.array([2.0, 0, -4]), 0.5)
    points = np.array([[1.0, 3.0], [5.0, 4.0], [1.0, 0.0]])
    assert outside(points, view, capsule) == pytest.approx([2.5, 4.5, -0.5])


@pytest.mark.long
def test_arms_alone_are_a_picture(make_recording):
    arms = np.array([n[2:] in ("shoulder", "elbow", "wrist", "hand") for n in JOINTS])
    found = [
        make_recording(walked(4.0, 0.0, seed=i), name=f"arms_{i}", observed=np.tile(arms, (100, 1)))
        for i in range(4)
    ]
    scores = score_recordings(constant(), found)
    entry, window = found_window(scores, "arms")
    scene = zone_scene(
        entry,
        window,
        Calibrated(constant(), calibration_of(scores, constant())),
        CoverageSettings(),
    )
    side, _ = views(scene, CANONICAL)
    assert side.origin[2] == 0.0  # no foot is seen: the room's floor
    assert len(zone_filmstrip([scene], CANONICAL, "kalman", "99 %").axes) == 2 * len(SHOWN_MS)
