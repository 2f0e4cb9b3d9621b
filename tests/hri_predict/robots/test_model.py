"""The robot model against pinocchio, published poses, and dense sampling."""

import copy
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RobotError
from hri_predict.base.files import data_path
from hri_predict.base.settings import Pose
from hri_predict.robots.model import RobotModel, load_robot
from tests.arms import arm_settings

UR5E: dict[str, Any] = yaml.safe_load(data_path("robots", "ur5e.yaml").read_text())
SHIPPED = sorted(p.stem for p in data_path("robots").glob("*.yaml"))
PLACED = Pose(xyz=[1.0, -2.0, 0.8], quaternion_xyzw=[0.0, 0.0, 0.6, 0.8])


settings_of = partial(arm_settings, payload_kg=2.5)


def ur5e(**more: Any) -> RobotModel:
    return load_robot(settings_of(**more), None)


def written(tmp_path: Path, robot: dict[str, Any]) -> RobotModel:
    (tmp_path / "r.yaml").write_text(yaml.safe_dump(robot))
    return load_robot(settings_of("r.yaml"), tmp_path)


def angles(limit: float) -> st.SearchStrategy[Floats]:
    return st.lists(st.floats(-limit, limit), min_size=6, max_size=6).map(np.array)


def in_pinocchio(placed: Pose) -> tuple[Any, Any]:
    """The published DH table as a pinocchio model: a turn about z, then the rest of the row."""
    model = pinocchio.Model()
    a = [0, -0.425, -0.3922, 0, 0, 0]
    d = [0.1625, 0, 0, 0.1333, 0.0997, 0.0996]
    alpha = [np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0]
    matrix = placed.matrix()
    before, parent = pinocchio.SE3(matrix[:3, :3], matrix[:3, 3]), 0
    for i in range(6):
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), before, f"j{i}")
        turn = pinocchio.utils.rotate("x", alpha[i])
        before = pinocchio.SE3(turn, np.array([a[i], 0.0, d[i]]))
        model.addFrame(
            pinocchio.Frame(f"link{i + 1}", parent, 0, before, pinocchio.FrameType.OP_FRAME)
        )
    return model, model.createData()


ORACLE, ORACLE_DATA = in_pinocchio(PLACED)


@given(angles(6.28), angles(3.14))
def test_capsules_and_their_velocities_equal_pinocchio(q: Floats, qd: Floats) -> None:
    robot = ur5e(room_from_robot=PLACED)
    placed = robot.capsules(q)
    pinocchio.forwardKinematics(ORACLE, ORACLE_DATA, q, qd)
    pinocchio.updateFramePlacements(ORACLE, ORACLE_DATA)
    chain = ["base", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"]
    parts = UR5E["capsules"] + [{**c, "link": "wrist_3"} for c in UR5E["tool"] + UR5E["payload"]]
    fastest = 0.0
    for part in parts:
        c = robot.capsule_names.index(part["name"])
        link = chain.index(part["link"])
        assert placed.radius[c] == part["radius"]
        for ours, local in ((placed.a[c], part["a"]), (placed.b[c], part["b"])):
            if link == 0:
                matrix = PLACED.matrix()
                expected, speed, turn = matrix[:3, :3] @ local + matrix[:3, 3], 0.0, 0.0
            else:
                frame = ORACLE.getFrameId(f"link{link}")
                pose = ORACLE_DATA.oMf[frame]
                expected = pose.act(np.array(local))
                velocity = pinocchio.getFrameVelocity(
                    ORACLE, ORACLE_DATA, frame, pinocchio.LOCAL_WORLD_ALIGNED
                )
                arm = expected - pose.translation
                speed = float(np.linalg.norm(velocity.linear + np.cross(velocity.angular, arm)))
                turn = float(np.linalg.norm(velocity.angular))
            np.testing.assert_allclose(ours, expected, atol=1e-12)
            fastest = max(fastest, speed + turn * part["radius"])
    assert float(robot.tip_speed(q, qd)) == pytest.approx(fastest, abs=1e-9)


def test_zero_pose_is_the_published_one() -> None:
    # Arm stretched along -x: a2 + a3, -(d4 + d6), d1 - d5 (Universal Robots' DH figure).
    robot = ur5e()
    flange = robot.capsules(np.zeros(6))
    gripper = robot.capsule_names.index("gripper")
    np.testing.assert_allclose(flange.a[gripper], [-0.8172, -0.2329 - 0.03, 0.0628], atol=1e-12)
    upright = robot.capsules(np.array([0, -np.pi / 2, 0, -np.pi / 2, 0, 0]))
    np.testing.assert_allclose(upright.a[gripper], [0, -0.2629, 0.9797 + 0.0997], atol=1e-12)


def test_urdf_style_origins_make_the_same_robot(tmp_path: Path) -> None:
    robot = copy.deepcopy(UR5E)
    previous = {"a": 0.0, "alpha": 0.0, "d": 0.0}
    for joint in robot["joints"]:
        row = joint.pop("dh")
        joint["origin"] = {
            "xyz": [previous["a"], 0, previous["d"]],
            "rpy": [previous["alpha"], 0, 0],
        }
        joint["axis"] = [0, 0, 1]
        previous = row
    # The child frame is now the one before the rest of the DH row: move the capsules along.
    rows = {j["child"]: j["dh"] for j in UR5E["joints"]}

    def moved(point: list[float], link: str) -> list[float]:
        row = rows.get(link)
        if row is None:
            return point
        c, s = np.cos(row["alpha"]), np.sin(row["alpha"])
        x, y, z = point
        return [float(v) for v in (x + row["a"], c * y - s * z, s * y + c * z + row["d"])]

    for part in robot["capsules"] + robot["tool"] + robot["payload"]:
        link = part.get("link", "wrist_3")
        part["a"], part["b"] = moved(part["a"], link), moved(part["b"], link)
    other, ours = written(tmp_path, robot), ur5e()
    q = np.random.default_rng(3).uniform(-6, 6, (20, 6))
    np.testing.assert_allclose(other.capsules(q).a, ours.capsules(q).a, atol=1e-12)
    np.testing.assert_allclose(other.capsules(q).b, ours.capsules(q).b, atol=1e-12)


def test_roll_pitch_yaw_and_slanted_axes_equal_pinocchio(tmp_path: Path) -> None:
    axis = np.array([0.6, 0.0, 0.8])
    robot = copy.deepcopy(UR5E)
    joint = robot["joints"][0]
    del joint["dh"]
    joint["origin"] = {"xyz": [0.1, 0.2, 0.3], "rpy": [0.4, -0.5, 0.6]}
    joint["axis"] = axis.tolist()
    robot["joints"] = [joint]
    robot["capsules"] = [c for c in robot["capsules"] if c["link"] in ("base", "shoulder")]
    placed = written(tmp_path, robot).capsules(np.array([0.7]))
    pose = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.4, -0.5, 0.6), np.array([0.1, 0.2, 0.3]))
    turn = pinocchio.SE3(pinocchio.exp3(axis * 0.7), np.zeros(3))
    expected = (pose * turn).act(np.array(robot["capsules"][1]["a"]))
    np.testing.assert_allclose(placed.a[1], expected, atol=1e-12)


def test_leading_dimensions() -> None:
    robot = ur5e()
    q = np.random.default_rng(0).uniform(-3, 3, (2, 4, 6))
    many = robot.capsules(q)
    count = len(robot.capsule_names)
    assert many.a.shape == many.b.shape == (2, 4, count, 3)
    assert many.radius.shape == (2, 4, count)
    one = robot.capsules(q[1, 2])
    np.testing.assert_allclose(many.a[1, 2], one.a, atol=1e-15)
    assert robot.tip_speed(q, q / 5).shape == (2, 4)


@given(angles(6.28), angles(3.0), st.integers(0, 2**32 - 1))
def test_tip_speed_bounds_every_point_of_the_axes(q: Floats, qd: Floats, seed: int) -> None:
    robot = ur5e()
    rng = np.random.default_rng(seed)
    step = 1e-6
    before, after = robot.capsules(q - qd * step / 2), robot.capsules(q + qd * step / 2)
    bound = float(robot.tip_speed(q, qd))
    along = rng.uniform(0, 1, (50, 1, 1))
    axis = (before.a + along * (before.b - before.a), after.a + along * (after.b - after.a))
    speeds = np.linalg.norm(axis[1] - axis[0], axis=-1) / step
    assert speeds.max() <= bound * (1 + 1e-6) + 1e-6


def test_reach_is_never_exceeded_and_nearly_reached() -> None:
    robot = ur5e(room_from_robot=PLACED)
    placed = robot.capsules(np.random.default_rng(1).uniform(-6, 6, (5000, 6)))
    for end in (placed.a, placed.b):
        assert robot.base is not None
        far = np.linalg.norm(end - robot.base, axis=-1) + placed.radius
        assert far.max() <= robot.reach_m
    assert robot.reach_m < 1.7


# --- stopping ---


@given(
    angles(3.0),
    angles(1.5),
    st.floats(0, 0.5),
    st.floats(0, 0.8),
    st.lists(st.floats(0, 0.15), min_size=1, max_size=12),
)
def test_stopping_capsules_contain_the_robot_throughout_each_interval(
    q: Floats, qd: Floats, reaction_s: float, stopping_s: float, steps: list[float]
) -> None:
    robot = ur5e()
    times = np.cumsum([0.0, *steps])
    held = robot.stopping_capsules(
        q, qd, times_s=times, reaction_s=reaction_s, stopping_s=stopping_s
    )
    assert held.a.shape == (len(times), len(robot.capsule_names), 3)
    speed = float(robot.tip_speed(q, qd))
    distance = robot.stopping(speed)[1]
    hold = 0.0 if speed == 0 else min(max(2 * distance / speed - stopping_s, 0), stopping_s)

    onset, braking = reaction_s + hold, stopping_s - hold

    def travelled(t: float) -> float:
        """Seconds of full speed: the area under the velocity profile, piecewise linear."""
        if braking == 0:
            return min(t, onset)
        grid = np.clip([0, onset, onset + braking, t], 0, t)
        grid = np.sort(np.concatenate([grid, np.linspace(0, t, 50)]))
        rate = np.clip(1 - (grid - onset) / braking, 0, 1)
        return float(np.sum((rate[1:] + rate[:-1]) / 2 * np.diff(grid)))

    for k in range(1, len(times)):
        for t in np.linspace(times[k - 1], times[k], 9):
            true = robot.capsules(q + qd * travelled(t))
            # A capsule holds another when its radius exceeds the other's by as much as their ends
            # are apart.
            shift = np.maximum(
                np.linalg.norm(true.a - held.a[k], axis=-1),
                np.linalg.norm(true.b - held.b[k], axis=-1),
            )
            assert np.all(shift + true.radius <= held.radius[k] + 1e-9)


def test_the_containment_bound_is_not_much_larger_than_needed() -> None:
    robot = ur5e()
    q, qd = np.array([0.3, -1.0, 1.2, -1.7, -1.5, 0.0]), np.array([0.8, 0.2, -0.3, 0.1, 0.0, 0.0])
    times = np.linspace(0.0, 1.0, 26)
    held = robot.stopping_capsules(q, qd, times_s=times, reaction_s=0.3, stopping_s=0.3)
    grown = held.radius - robot.capsules(q).radius
    speed = float(robot.tip_speed(q, qd))
    assert np.all(grown[0] == 0)
    assert grown.max() <= 1.2 * speed * 0.02  # half an interval at full speed
    assert np.all(grown[20:] == 0)  # at rest
    assert np.all(grown[:, 0] == 0)  # the base does not move


def test_the_path_is_as_long_as_the_table_says() -> None:
    robot = ur5e()
    q, qd = np.array([0.3, -0.3, 0.4, -1.7, -1.5, 0.0]), np.array([0.6, 0, 0, 0, 0, 0])
    speed = float(robot.tip_speed(q, qd))
    time_s, distance = robot.stopping(speed)
    end = robot.stopping_capsules(q, qd, times_s=np.array([9.0]), reaction_s=0.0, stopping_s=time_s)
    # Rotation about the base's axis alone: the tip's arc is the table's distance.
    turned = np.arctan2(end.b[0, -1, 1], end.b[0, -1, 0]) - np.arctan2(
        robot.capsules(q).b[-1, 1], robot.capsules(q).b[-1, 0]
    )
    assert abs(turned) * speed / 0.6 == pytest.approx(distance, rel=1e-6)


@pytest.mark.parametrize("payload", [0.0, 1.0, 2.5, 3.0, 5.0, None])
def test_stopping_is_monotone_in_speed(payload: float | None) -> None:
    robot = ur5e(payload_kg=payload)
    table = np.array([robot.stopping(v) for v in np.linspace(0, 5, 401)])
    assert np.all(np.diff(table, axis=0) >= 0)
    assert np.all(table[0] == 0)
    rows = {r["payload_kg"]: r for r in UR5E["stopping"]["rows"]}
    row = rows[min(k for k in rows if k >= (5.0 if payload is None else payload))]
    for v, t, d in zip(
        UR5E["stopping"]["speed_m_s"], row["time_s"], row["distance_m"], strict=True
    ):
        assert robot.stopping(v) == pytest.approx((t, d))


def test_stopping_beyond_the_table_keeps_the_last_deceleration() -> None:
    robot = ur5e()
    assert robot.stopping(6.0) == pytest.approx((0.8 * 2, 1.275 * 4))
    assert robot.stopping(0.05)[0] == robot.stopping(0.1)[0]
    with pytest.raises(ValueError):
        robot.stopping(float("nan"))


def test_a_robot_that_carries_nothing_has_no_payload_capsule() -> None:
    assert "payload" in ur5e().capsule_names
    assert "payload" in ur5e(payload_kg=None).capsule_names
    assert "payload" not in ur5e(payload_kg=0.0).capsule_names


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_robots_load(name: str) -> None:
    robot = load_robot(settings_of(name, payload_kg=None), None)
    assert robot.dof == len(robot.joint_names)
    assert np.isfinite(robot.capsules(np.zeros(robot.dof)).a).all()


# --- mistakes ---


def joint(i: int, key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda robot: robot["joints"][i].__setitem__(key, value)


def row(i: int, key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda robot: robot["stopping"]["rows"][i].__setitem__(key, value)


TIMES = UR5E["stopping"]["rows"][1]["time_s"]
MISTAKES: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "unknown parent": (joint(2, "parent", "uper_arm"), "broken chain.*did you mean 'upper_arm'"),
    "cycle": (joint(3, "child", "shoulder"), "broken chain.*loop"),
    "own parent": (joint(2, "child", "upper_arm"), "broken chain.*loop"),
    "gap": (joint(2, "parent", "shoulder"), "broken chain.*ends at 'upper_arm'"),
    "joint left out": (lambda r: r["joints"].pop(2), "broken chain.*'forearm' does not exist"),
    "same joint name": (joint(1, "name", "elbow"), "'elbow' is used twice"),
    "no joints": (lambda r: r.update(joints=[]), "joints"),
    "unknown type": (joint(0, "type", "planar"), "joints.0.type"),
    "turn in metres": (
        lambda r: r["joints"][0].update(type="prismatic", velocity=25.0),
        "in metres: position at most 8 m",
    ),
    "missing capsule": (lambda r: r["capsules"].pop(3), "link 'forearm' has no capsule"),
    "capsule on no link": (
        lambda r: r["capsules"][3].update(link="forarm"),
        "no link 'forarm'; did you mean 'forearm'",
    ),
    "capsule name twice": (lambda r: r["tool"][0].update(name="base"), "'base' is used twice"),
    "radius 0": (lambda r: r["capsules"][0].update(radius=0), "capsules.0.radius"),
    "not finite": (lambda r: r["capsules"][0].update(a=[0, float("nan"), 0]), "capsules.0.a.1"),
    "infinite": (lambda r: r["joints"][0]["dh"].update(d=float("inf")), "joints.0.dh.d"),
    "beyond a kilometre": (lambda r: r["capsules"][0].update(a=[1e300, 0, 0]), "capsules.0.a.0"),
    "absurd velocity": (joint(0, "velocity", 1e300), "joints.0.velocity"),
    "absurd stopping": (row(2, "time_s", [1e300] * 10), "rows.2.time_s.0"),
    "limits reversed": (joint(0, "position", [1, -1]), "lower, upper"),
    "dh and origin": (joint(0, "origin", {"xyz": [0, 0, 0]}), "either dh or origin"),
    "neither": (lambda r: r["joints"][0].pop("dh"), "either dh or origin"),
    "axis with dh": (joint(0, "axis", [0, 0, 1]), "axis requires origin"),
    "misspelt key": (joint(0, "velocitiy", 1), "did you mean 'velocity'"),
    "no velocity": (lambda r: r["joints"][0].pop("velocity"), "joints.0.velocity: required"),
    "speeds fall": (
        lambda r: r["stopping"]["speed_m_s"].__setitem__(2, 0.2),
        "speed_m_s must increase",
    ),
    "time falls": (row(1, "time_s", [*TIMES[:-1], 0.1]), "2.5 kg.*must not fall"),
    "heavier stops sooner": (row(1, "time_s", [0.06, *TIMES[1:]]), "2.5 kg.*heavier payload"),
    "rows out of order": (lambda r: r["stopping"]["rows"].reverse(), "increasing payload_kg"),
    "values missing": (row(1, "time_s", TIMES[:-1]), "one time_s and distance_m for every"),
    "millimetres": (row(2, "distance_m", [float(i) for i in range(1, 11)]), "check the units"),
    "no source": (lambda r: r.pop("source"), "source: required"),
}


@pytest.mark.parametrize("case", MISTAKES, ids=list(MISTAKES))
def test_mistakes_give_one_line_that_names_the_file(tmp_path: Path, case: str) -> None:
    spoil, message = MISTAKES[case]
    robot = copy.deepcopy(UR5E)
    spoil(robot)
    with pytest.raises(RobotError, match=message) as caught:
        written(tmp_path, robot)
    assert "\n" not in str(caught.value)
    assert "r.yaml" in str(caught.value)


def test_a_payload_above_the_table_is_refused() -> None:
    with pytest.raises(RobotError, match=r"payload_kg: 7.*ends at 5 kg.*add a row"):
        ur5e(payload_kg=7.0)


def test_a_model_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="unknown robot model 'ur5x'; did you mean 'ur5"):
        load_robot(settings_of("ur5x"), None)
    with pytest.raises(RobotError, match=r"nowhere\.yaml: cannot be read"):
        load_robot(settings_of("nowhere.yaml"), tmp_path)
    with pytest.raises(RobotError, match=r"ur5e\.yaml: cannot be read: No such.*mean 'ur5e'"):
        load_robot(settings_of("ur5e.yaml"), tmp_path)
    (tmp_path / "list.yaml").write_text("- 1\n")
    with pytest.raises(RobotError, match="expected keys and values"):
        load_robot(settings_of("list.yaml"), tmp_path)
