"""What judging costs at its dearest: several people near several moving robots, all horizons."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hri_predict.link import LinkSettings
from hri_predict.predictors.base import Forecast
from hri_predict.protocol.messages import RobotMode, RobotState
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.engine import RiskEngine
from hri_predict.risk.robot import RobotSettings, StateMotion, load_robot
from hri_predict.risk.robot_tracker import RobotTracker
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.trajectory import load_trajectory
from hri_predict.scene import Floats
from hri_predict.settings import Pose
from hri_predict.skeleton import CANONICAL, JOINTS
from hri_predict.snapshot import PeopleSnapshot

RATE_HZ, STEPS, SEGMENTS, PEOPLE = 25.0, 25, 20, 4
TITLE = f"risk: {PEOPLE} people x {SEGMENTS} segments x {STEPS} horizons x 2 robots x 8 capsules"
NOW_NS = 10**9
AGE_NS = 10_000_000
_PHASES_S = (1.6, 4.8)  # where on their way the two arms are
_PEOPLE_AT = ((1.1, 2.5), (1.6, -2.5), (-0.9, -2.5), (3.0, 2.5))


def risk_calls() -> tuple[Callable[[], object], Callable[[], object]]:
    """Zones of people who walk up to two arms on their way, and judging them.

    One arm's plan is known, the other's is not. Delays are such that all horizons are looked at.
    """
    link = LinkSettings(name="bus", kind="can", reaction_s=0.41)
    engine = RiskEngine(
        RiskSettings(mode="predictive"),
        [_arm("planned", (0.0, 0.0), 0), _arm("unplanned", (2.2, 0.0), 1)],
        # three segments twice, as some skeletons have more
        replace(CANONICAL, segments=(*CANONICAL.segments, *CANONICAL.segments)[:SEGMENTS]),
        [],
        [],
        None,
        DelayBudget.from_settings(RATE_HZ, [link], stale_s=AGE_NS * 1e-9),
        RATE_HZ,
        STEPS,
    )
    snapshot, forecast = _walkers()
    bodies = engine.zones(snapshot, forecast)
    return lambda: engine.zones(snapshot, forecast), lambda: engine.judge(snapshot, bodies)


def _arm(name: str, at: tuple[float, float], which: int) -> RobotTracker:
    settings = RobotSettings(
        name=name,
        model="ur5e",
        room_from_robot=Pose(xyz=[*at, 0.0]),
        payload_kg=0.0,  # without the payload's capsule it has 8
        max_speed_m_s=1.5,
        motion=StateMotion(plan="pick_and_place" if name == "planned" else None),
    )
    model = load_robot(settings, None)
    tracker = RobotTracker(settings, model)
    q, qd = load_trajectory("pick_and_place", model, None).at_phase(_PHASES_S[which], 0.5)
    state = RobotState(which, RobotMode.AUTOMATIC, 1, tuple(q.tolist()), tuple(qd.tolist()))
    tracker.update(state, NOW_NS)
    return tracker


def _walkers() -> tuple[PeopleSnapshot, Forecast]:
    """People on their way to the arms at 0.5 m/s, and where they will be."""
    start = _standing() + np.array([(*at, 0.0) for at in _PEOPLE_AT])[:, None]
    towards = -np.array([(*at, 0.0) for at in _PEOPLE_AT])
    velocity = 0.5 * towards / np.linalg.norm(towards, axis=1, keepdims=True)
    times = np.arange(1 - STEPS, STEPS + 1) / RATE_HZ
    path = start[:, None] + times[:, None, None] * velocity[:, None, None]  # (P, T + H, J, 3)
    people = len(start)
    snapshot = PeopleSnapshot(
        now_ns=NOW_NS,
        ids=tuple(range(people)),
        history=path[:, :STEPS],
        observed=np.ones((people, STEPS, len(JOINTS)), bool),
        capture_ns=np.full(people, NOW_NS - AGE_NS, np.int64),
        last_positions=path[:, STEPS - 1],
        joint_age_s=np.zeros((people, len(JOINTS))),
        lost=(),
        reasons=(),
        newest_capture_ns=NOW_NS - AGE_NS,
        captures=1,
        counters={},
    )
    return snapshot, Forecast(path[:, STEPS:], None)


def _standing() -> Floats:
    """(J, 3) a body that stands upright at the origin, arms down."""
    height = {"waist": 1.0, "torso": 1.2, "neck": 1.45, "head": 1.6, "head_top": 1.75}
    limb = {
        "shoulder": (0.18, 1.4), "elbow": (0.2, 1.1), "wrist": (0.2, 0.85), "hand": (0.2, 0.68),
        "hip": (0.1, 0.95), "knee": (0.1, 0.5), "ankle": (0.1, 0.1), "foot": (0.1, 0.03),
    }  # fmt: skip
    place = {joint: (0.0, 0.0, z) for joint, z in height.items()}
    for side, sign in (("l_", 1.0), ("r_", -1.0)):
        place |= {side + joint: (0.0, sign * y, z) for joint, (y, z) in limb.items()}
    return np.array([place[joint] for joint in JOINTS])
