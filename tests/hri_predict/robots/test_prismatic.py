"""Prismatic joints: against pinocchio, and against dense sampling of what they sweep."""

from pathlib import Path

import numpy as np
import pinocchio
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules
from hri_predict.protocol.messages import RobotState
from hri_predict.protocol.reasons import Reason
from hri_predict.robots.model import RobotModel, RobotSettings, load_robot
from hri_predict.robots.tracker import RobotTracker
from tests.hri_predict.robots import nine_joints
from tests.hri_predict.robots.nine_joints import LIFT, PLACED, RAIL, TWIST, UR5E
from tests.messages import make_state

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return nine_joints.model(tmp_path_factory.mktemp("robot"))


def in_pinocchio() -> pinocchio.Model:
    """The same chain in another library."""
    built = pinocchio.Model()
    rpy = pinocchio.rpy.rpyToMatrix(*RAIL["origin"]["rpy"])
    room = PLACED.matrix()
    before = pinocchio.SE3(room[:3, :3], room[:3, 3]) * pinocchio.SE3(
        rpy, np.array(RAIL["origin"]["xyz"])
    )
    slide = pinocchio.JointModelPrismaticUnaligned(np.array(RAIL["axis"]))
    parent = built.addJoint(0, slide, before, "rail")
    before = pinocchio.SE3.Identity()
    for row in [*(j["dh"] for j in UR5E["joints"]), LIFT["dh"]]:
        kind = pinocchio.JointModelPZ() if row is LIFT["dh"] else pinocchio.JointModelRZ()
        parent = built.addJoint(parent, kind, before, f"j{parent}")
        turned = pinocchio.SE3(pinocchio.utils.rotate("z", row.get("theta", 0.0)), np.zeros(3))
        rest = pinocchio.utils.rotate("x", row["alpha"])
        before = turned * pinocchio.SE3(rest, np.array([row["a"], 0.0, row["d"]]))
    before = before * pinocchio.SE3(np.eye(3), np.array(TWIST["origin"]["xyz"]))
    built.addJoint(parent, pinocchio.JointModelRY(), before, "twist")
    return built


ORACLE = in_pinocchio()


@given(seeds)
def test_places_and_speeds_equal_pinocchio(robot: RobotModel, seed: int) -> None:
    (q,), (qd,) = nine_joints.drawn(robot, np.random.default_rng(seed), 1)
    data = ORACLE.createData()
    pinocchio.forwardKinematics(ORACLE, data, q, qd)
    hand, placed = robot.capsule_names.index("hand"), robot.capsules(q)
    pose = data.oMi[ORACLE.njoints - 1]
    np.testing.assert_allclose(placed.a[hand], pose.translation, atol=1e-12)
    np.testing.assert_allclose(placed.b[hand], pose.act(np.array([0, 0, 0.1])), atol=1e-12)
    velocity = pinocchio.getVelocity(
        ORACLE, data, ORACLE.njoints - 1, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    )
    turn = np.linalg.norm(velocity.angular)
    ends = (pose.rotation @ np.array([0, 0, z]) for z in (0.0, 0.1))
    speed = max(np.linalg.norm(velocity.linear + np.cross(velocity.angular, r)) for r in ends)
    assert float(robot.tip_speed(q, qd)) >= speed + turn * 0.05 - 1e-9
    alone = np.where(np.arange(robot.dof) == 0, qd, 0.0)  # the rail moves all alike
    assert float(robot.tip_speed(q, alone)) == pytest.approx(abs(qd[0]))


@given(seeds)
def test_no_capsule_is_ever_beyond_the_reach(robot: RobotModel, seed: int) -> None:
    q, _ = nine_joints.drawn(robot, np.random.default_rng(seed), 200)
    placed = robot.capsules(q)
    assert robot.base is not None
    far = np.maximum(*(np.linalg.norm(end - robot.base, axis=-1) for end in (placed.a, placed.b)))
    assert (far + placed.radius).max() <= robot.reach_m


def holds(held: Capsules, true: Capsules) -> bool:
    """Whether each capsule contains the other; surely, though not only, if the ends are near."""
    pairs = ((held.a, true.a), (held.b, true.b))
    shift = np.maximum(*(np.linalg.norm(x - y, axis=-1) for x, y in pairs))
    return bool(np.all(shift + true.radius <= held.radius + 1e-9))


@given(seeds, st.floats(0.0, 0.3), st.lists(st.floats(0.0, 0.15), min_size=1, max_size=8))
def test_what_it_sweeps_contains_it_between_the_steps(
    robot: RobotModel, seed: int, reaction_s: float, steps: list[float]
) -> None:
    """Along q(u) = q + qd u, whose u at the steps the capsules' own call gives."""
    (q,), (qd,) = nine_joints.drawn(robot, np.random.default_rng(seed), 1)
    times, speed = np.cumsum([0.0, *steps]), float(robot.tip_speed(q, qd))
    stopping_s = robot.stopping(speed)[0]
    held = robot.stopping_capsules(
        q, qd, times_s=times, reaction_s=reaction_s, stopping_s=stopping_s
    )
    fine = np.sort(np.concatenate([times, np.linspace(0, times[-1], 60)]))
    travel = robot.travel_s(np.array([speed]), fine, reaction_s, np.array([stopping_s]))
    true = robot.capsules(q + travel[:, None] * qd)
    for t, a, b, radius in zip(fine, true.a, true.b, true.radius, strict=True):
        k = int(np.searchsorted(times, t))
        one = Capsules(held.a[k], held.b[k], held.radius[k])
        assert holds(one, Capsules(a, b, radius))


@given(seeds, st.floats(0.01, 0.3))
def test_a_bent_path_stays_in_its_stretch(robot: RobotModel, seed: int, half: float) -> None:
    bent(robot, np.random.default_rng(seed), half, [4.0] * robot.dof)


def bent(robot: RobotModel, rng: np.random.Generator, half: float, ddq_most: list[float]) -> None:
    """A parabola in every joint, with the bounds of its derivatives."""
    (q,), (dq,) = nine_joints.drawn(robot, rng, 1)
    ddq = np.array(ddq_most) * rng.choice([-1.0, 0.0, 1.0], robot.dof)
    u = np.linspace(0.0, 2 * half, 41)[:, None]
    path = q + dq * u + ddq * u * u / 2
    most = np.maximum(np.abs(dq), np.abs(dq + ddq * 2 * half))
    swept = robot.swept_capsules(path[[0, -1]], most, np.abs(ddq), np.array([0.0, half]))
    for place in path:
        true = robot.capsules(place)
        assert holds(Capsules(swept.a[1], swept.b[1], swept.radius[1]), true)


@pytest.fixture(scope="module")
def telescope(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    """A telescope that turns about its end: no rigid piece hides what sliding adds."""
    folder = tmp_path_factory.mktemp("telescope")
    turn = {**TWIST, "name": "turn", "parent": "base", "child": "tube", "origin": {"xyz": [0] * 3}}
    slide = {**RAIL, "parent": "tube", "child": "tip", "origin": {"xyz": [0] * 3}}
    point = {"a": [0.0] * 3, "b": [0.0] * 3, "radius": 0.01}
    data = {
        "name": "telescope",
        "source": "made up",
        "base": "base",
        "joints": [turn, slide | {"axis": [1, 0, 0]}],
        "capsules": [{"name": link, "link": link, **point} for link in ("base", "tube", "tip")],
        "stopping": UR5E["stopping"],
    }
    (folder / "r.yaml").write_text(yaml.safe_dump(data))
    settings = RobotSettings(
        name="t", model="r.yaml", room_from_robot=PLACED, max_speed_m_s=1.0, payload_kg=0.0
    )
    return load_robot(settings, folder)


@given(seeds, st.floats(0.01, 0.3))
def test_a_telescope_that_turns_stays_in_its_stretch(
    telescope: RobotModel, seed: int, half: float
) -> None:
    bent(telescope, np.random.default_rng(seed), half, [2.0, 2.0])


def test_the_bound_is_not_much_larger_than_needed(robot: RobotModel) -> None:
    q, qd = np.zeros(9), np.zeros(9)
    qd[[0, 7]] = 0.5, 0.2  # only sliding: every point moves straight on
    held = robot.swept_capsules(
        q + np.array([[0.0], [0.04]]) * qd, np.abs(qd), np.zeros(9), np.array([0.0, 0.02])
    )
    grown = held.radius[1] - robot.capsules(q).radius
    assert grown[robot.capsule_names.index("floor")] == 0
    assert grown.max() <= 0.7 * 0.02 + 1e-12
    assert robot.shift_m(np.array([0.01, *np.zeros(8)])) == pytest.approx(0.01)


def told(q: Floats, qd: Floats) -> RobotState:
    return make_state(tuple(q.tolist()), tuple(qd.tolist()))


@pytest.mark.parametrize(
    ("position", "velocity", "expected"),
    [
        (2.0, 1.0, ()),
        (2.009, 1.0, ()),
        (2.02, 0.0, (Reason.ROBOT_STATE_INVALID,)),
        (0.0, 1.4, (Reason.ROBOT_STATE_INVALID,)),
    ],
    ids=["at the end", "noise", "beyond the end", "too fast"],
)
def test_the_limits_of_a_rail_are_metres(
    robot: RobotModel, position: float, velocity: float, expected: tuple[Reason, ...]
) -> None:
    settings = RobotSettings(name="arm", model="x", room_from_robot=PLACED, max_speed_m_s=1.0)
    tracker = RobotTracker(settings, robot)
    q, qd = np.zeros(9), np.zeros(9)
    q[0], qd[0] = position, velocity
    tracker.update(told(q, qd), 0)
    assert tracker.at(1_000_000).reasons == expected
    now = tracker.at(50_000_000)
    if not expected:
        assert now.q is not None
        assert now.q[0] == pytest.approx(max(position, 2.0))  # moved on, but not past its end


def test_mistakes_name_the_unit(tmp_path: Path, robot: RobotModel) -> None:
    from hri_predict.base.errors import RobotError
    from hri_predict.robots.trajectory import load_trajectory

    start, end = [0.0] * 9, [2.5, *[0.0] * 8]
    for far, match in ((2.5, r"'rail' at 2.5 m is outside -1.5 .. 2"), (2.0, "3.75 m/s, above")):
        end[0] = far
        (tmp_path / "t.yaml").write_text(
            f"waypoints:\n- {{time_s: 0, positions: {start}}}\n- {{time_s: 1, positions: {end}}}\n"
            f"- {{time_s: 2, positions: {start}}}\n"
        )
        with pytest.raises(RobotError, match=match):
            load_trajectory("t.yaml", robot, tmp_path)
