"""Trajectories: smoothness, limits, the shipped cycle, and mistakes."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import RobotError
from hri_predict.base.files import data_path
from hri_predict.robots.model import RobotModel, load_robot
from hri_predict.robots.trajectory import PEAK, Trajectory, load_trajectory
from tests.arms import arm_settings
from tests.hri_predict.robots import mobile

FILE: dict[str, Any] = yaml.safe_load(data_path("trajectories", "pick_and_place.yaml").read_text())
SHIPPED = {
    "pick_and_place": ["ur5e", "ur5"],
    "panda_pick_and_place": ["panda", "fr3"],
    "iiwa_pick_and_place": ["iiwa14_r820", "iiwa7_r800"],
    "ur10e_pick_and_place": ["ur10e"],
    "rail_pick_and_place": ["ur10e_rail"],
    "drive_and_pick": ["mobile"],
}


def robot(name: str, payload_kg: float) -> RobotModel:
    if name == "mobile":
        return load_robot(mobile.settings_of(payload_kg=payload_kg), None)
    settings = arm_settings(name, payload_kg=payload_kg)
    return load_robot(settings, None)


MODEL = robot("ur5e", 2.5)


def test_every_shipped_trajectory_is_tested() -> None:
    assert set(SHIPPED) == {p.stem for p in data_path("trajectories").glob("*.yaml")}


@st.composite
def trajectories(draw: st.DrawFn) -> Trajectory:
    count = draw(st.integers(2, 5))
    spans = draw(st.lists(st.floats(0.1, 3), min_size=count, max_size=count))
    seed = draw(st.integers(0, 2**32 - 1))
    positions = np.random.default_rng(seed).uniform(-3, 3, (count, 6))
    return Trajectory(np.cumsum([0.0, *spans]), np.vstack([positions, positions[:1]]))


@given(trajectories())
def test_velocity_is_the_derivative_and_is_continuous(path: Trajectory) -> None:
    t = np.linspace(0, 2 * path.duration_s, 4001)
    q, qd = path.at(t)
    step = t[1] - t[0]
    # The trapezoid of a velocity of bounded third derivative; the bound follows from spans >= 0.1.
    area = (
        q[0] + np.concatenate([np.zeros((1, 6)), np.cumsum((qd[1:] + qd[:-1]) / 2, axis=0)]) * step
    )
    assert np.max(np.abs(area - q)) < 0.02
    acceleration = 5.774 * 6 / 0.1**2  # greatest of a minimum-jerk move of 6 rad in 0.1 s
    assert np.max(np.abs(np.diff(qd, axis=0))) <= acceleration * step * 1.001


@given(trajectories(), st.floats(0, 50), st.integers(1, 5))
def test_it_is_cyclic(path: Trajectory, t: float, cycles: int) -> None:
    first, again = path.at(t), path.at(t + cycles * path.duration_s)
    np.testing.assert_allclose(again[0], first[0], atol=1e-7)
    np.testing.assert_allclose(again[1], first[1], atol=1e-4)


@given(trajectories())
def test_it_rests_at_waypoints_and_stays_between_them(path: Trajectory) -> None:
    times, points = path.moves[0], path.moves[1]
    q, qd = path.at(times[:-1])
    np.testing.assert_allclose(q, points[:-1], atol=1e-12)
    np.testing.assert_allclose(qd, 0, atol=1e-9)
    for i in range(len(times) - 1):
        q, qd = path.at(np.linspace(times[i], times[i + 1], 101)[:-1])
        low, high = np.minimum(points[i], points[i + 1]), np.maximum(points[i], points[i + 1])
        assert np.all(q >= low - 1e-12)
        assert np.all(q <= high + 1e-12)
        mean = np.abs(points[i + 1] - points[i]) / (times[i + 1] - times[i])
        assert np.max(np.abs(qd), axis=0) == pytest.approx(PEAK * mean, rel=1e-9)


def test_shapes_and_slower_running() -> None:
    path = load_trajectory("pick_and_place", MODEL, None)
    q, qd = path.at(np.linspace(0, 5, 12).reshape(3, 4))
    assert q.shape == qd.shape == (3, 4, 6)
    one, one_d = path.at(1.7)
    assert one.shape == one_d.shape == (6,)
    half, half_d = path.at_phase(1.7, 0.5)
    np.testing.assert_array_equal(half, one)
    np.testing.assert_allclose(half_d, one_d / 2)
    assert np.all(path.at_phase(1.7, 0.0)[1] == 0)


@pytest.mark.parametrize(("name", "arm"), [(n, arm) for n in SHIPPED for arm in SHIPPED[n]])
def test_shipped_trajectories_are_what_they_say(name: str, arm: str) -> None:
    model = robot(arm, 2.5)
    path = load_trajectory(name, model, None)
    assert 0.9 <= path.peak_tip_speed(model) <= 1.0
    q, _ = path.at(np.linspace(0, path.duration_s, 500))
    placed = model.capsules(q)
    lowest = np.minimum(placed.a[..., 2], placed.b[..., 2]) - placed.radius
    fixed = ("base", "panda_link0", "fr3_link0", "base_link")
    moving = [i for i, name in enumerate(model.capsule_names) if name not in fixed]
    assert lowest[:, moving].min() > -0.1  # above the floor of a cell with the arm on a pedestal


@pytest.mark.parametrize(
    ("name", "arm", "out", "sides", "low", "high", "duration", "peak"),
    [
        ("pick_and_place", "ur5e", 0.7, (40, -40), 0.15, 0.35, 6.4, 0.95),
        ("pick_and_place", "ur5", 0.691, (38.1, -41.9), 0.094, 0.294, 6.4, 0.94),
        ("panda_pick_and_place", "panda", 0.55, (40, -40), 0.15, 0.35, 5.6, 0.95),
    ],
)
def test_it_goes_where_its_comment_says(
    name: str,
    arm: str,
    out: float,
    sides: tuple[float, float],
    low: float,
    high: float,
    duration: float,
    peak: float,
) -> None:
    model = robot(arm, 2.5)
    path = load_trajectory(name, model, None)
    payload = model.capsule_names.index("payload")
    place_s = duration / 2  # the second half mirrors the first
    for time_s, degrees, height in (
        (0.5, sides[0], low),
        (1.0, sides[0], high),
        (place_s, sides[1], high),
        (place_s + 0.5, sides[1], low),
    ):
        placed = model.capsules(path.at(time_s)[0])
        grip = (placed.a[payload] + placed.b[payload]) / 2
        angle = np.radians(degrees)
        expected = [out * np.cos(angle), out * np.sin(angle), height]
        np.testing.assert_allclose(grip, expected, atol=0.002)
    assert path.duration_s == duration
    assert path.peak_tip_speed(model) == pytest.approx(peak, abs=0.005)


def test_one_quick_move_in_a_long_cycle_is_not_missed() -> None:
    model = robot("ur5e", 2.5)
    quick = load_trajectory("pick_and_place", model, None)
    times, positions, _ = quick.moves
    slow = Trajectory(np.append(times, 3600.0), np.vstack([positions, positions[-1:]]))
    peak = quick.peak_tip_speed(model)
    assert slow.peak_tip_speed(model) == pytest.approx(peak, rel=1e-9)
    dense = model.tip_speed(*quick.at(np.linspace(0.0, quick.duration_s, 20_001)))
    assert peak >= 0.998 * dense.max()


MISTAKES: dict[str, tuple[Any, str]] = {
    "joint count": (
        lambda f: f["waypoints"][2]["positions"].pop(),
        r"waypoints\.2: 5 positions.*6 joints",
    ),
    "not closed": (lambda f: f["waypoints"].pop(), "must repeat the first"),
    "late start": (lambda f: f["waypoints"][0].update(time_s=0.1), "must be at 0"),
    "time falls": (lambda f: f["waypoints"][3].update(time_s=1.0), r"waypoints\.3: time_s"),
    "outside limits": (
        lambda f: f["waypoints"][1]["positions"].__setitem__(2, 6.5),
        r"waypoints\.1: joint 'elbow' at 6\.5 rad",
    ),
    "too fast": (
        lambda f: f["waypoints"][1]["positions"].__setitem__(2, 5.0),
        r"waypoints\.1: joint 'elbow' would reach .* more time",
    ),
    "not finite": (
        lambda f: f["waypoints"][1]["positions"].__setitem__(2, float("nan")),
        r"waypoints\.1\.positions\.2",
    ),
    "one waypoint": (lambda f: f.update(waypoints=f["waypoints"][:1]), "waypoints"),
    "misspelt": (lambda f: f.update(waypoint=1), "did you mean 'waypoints'"),
}


@pytest.mark.parametrize("case", MISTAKES, ids=list(MISTAKES))
def test_mistakes_give_one_line(tmp_path: Path, case: str) -> None:
    spoil, message = MISTAKES[case]
    data = copy.deepcopy(FILE)
    spoil(data)
    (tmp_path / "t.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(RobotError, match=message) as caught:
        load_trajectory("t.yaml", MODEL, tmp_path)
    assert "\n" not in str(caught.value)
    assert "t.yaml" in str(caught.value)


def test_unknown_names(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"'pick_n_place'; did you mean 'pick_and_place'"):
        load_trajectory("pick_n_place", MODEL, None)
    with pytest.raises(RobotError, match="cannot be read"):
        load_trajectory("none.yaml", MODEL, tmp_path)


MOVES = "waypoints: [{time_s: 0, positions: &q [0, 0, 0, 0, 0, 0]%s}, {time_s: 1, positions: *q%s}]"


@pytest.mark.parametrize(
    ("name", "base", "message"),
    [
        ("mobile", "", "the base of robot 'amr' moves; give base"),
        ("ur5e", ", base: [0, 0, 0]", "the base of robot 'arm' is fixed; omit base"),
        ("mobile", ", base: [0, 0]", "waypoints.0.base"),
    ],
)
def test_a_base_that_does_not_fit(tmp_path: Path, name: str, base: str, message: str) -> None:
    (tmp_path / "t.yaml").write_text(MOVES % (base, base))
    with pytest.raises(RobotError, match=message):
        load_trajectory("t.yaml", robot(name, 2.5), tmp_path)


def test_a_base_that_is_too_fast_along_its_way(tmp_path: Path) -> None:
    """Each of x and y is within the limit, and their way is not."""
    there = [[0, 0, 0], [0.5, 0.5, 0], [0, 0, 0]]
    lines = [f"- {{time_s: {t}, positions: {[0] * 6}, base: {at}}}" for t, at in enumerate(there)]
    (tmp_path / "t.yaml").write_text("waypoints:\n" + "\n".join(lines))
    with pytest.raises(
        RobotError, match=r"waypoints.1: the base would reach 1.33 m/s, above its 1"
    ):
        load_trajectory("t.yaml", robot("mobile", 2.5), tmp_path)
