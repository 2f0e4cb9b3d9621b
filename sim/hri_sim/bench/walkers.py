"""The slowest case of the risk judgement: several people near moving robots, all horizons."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.body.standing import standing_body
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.messages import RobotMode, RobotState
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.engine import RiskEngine
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.types import Assessment
from hri_predict.robots.model import RobotSettings, StateMotion, load_robot
from hri_predict.robots.tracker import RobotTracker
from hri_predict.robots.trajectory import load_trajectory
from hri_predict.zones.calibration import load_calibration, shipped_calibration

RATE_HZ, STEPS, SEGMENTS, PEOPLE = 25.0, 25, 20, 4
TITLE = f"risk: {PEOPLE} people x {SEGMENTS} segments x {STEPS} horizons x 2 robots x 8 capsules"
NOW_NS = 10**10
TICK_NS = 40_000_000
AGE_NS = 10_000_000
_STATES = 40
_PHASES_S = (1.6, 4.8)  # phases of the two arms on their trajectories
_PEOPLE_AT = ((1.45, 3.9), (2.05, -3.9), (-1.65, -3.7), (3.9, 3.7))
_WALK_TICKS = 50  # people come into view and walk up; then the next people come


def risk_calls() -> tuple[Callable[[], object], Callable[[], object]]:
    """Return two calls to time: the zones of people who walk up to two arms, and their judgement.

    The first call computes the zones of the next tick, with the shipped calibration and the
    self-check. The second judges the last tick. One arm's plan is known, the other's is not. The
    delays are so long that all horizons are used.
    """
    link = LinkSettings(name="bus", kind="can", silence_timeout_s=0.15, reaction_s=0.41)
    engine = RiskEngine(
        settings=RiskSettings(mode="predictive"),
        robots=[_arm("planned", (0.0, 0.0), 0), _arm("unplanned", (2.2, 0.0), 1)],
        # three segments twice, as some skeletons have more
        skeleton=replace(CANONICAL, segments=(*CANONICAL.segments, *CANONICAL.segments)[:SEGMENTS]),
        absent_parts=[],
        named_zones=[],
        field_of_view=None,
        budget=DelayBudget.from_settings(RATE_HZ, [link], stale_s=AGE_NS * 1e-9),
        forecast_rate_hz=RATE_HZ,
        horizon_steps=STEPS,
        calibration=load_calibration(shipped_calibration("constant_velocity")),
    )
    ticks = [_walkers(tick) for tick in range(_WALK_TICKS)]
    walks = itertools.count()

    def walk() -> Iterator[tuple[PeopleSnapshot, Forecast]]:
        for number in walks:
            for snapshot, forecast in ticks:
                yield _later(snapshot, number), forecast

    walking = walk()
    bodies = [engine.zones(*next(walking)) for _ in ticks][-1]
    snapshot = ticks[-1][0]

    def judge() -> Assessment:
        findings = engine.separation(bodies, engine.robots(snapshot.now_ns))
        return engine.levels(snapshot, bodies, findings)

    return lambda: engine.zones(*next(walking)), judge


def _later(snapshot: PeopleSnapshot, walk: int) -> PeopleSnapshot:
    """Return the snapshot of a later walk: other people's ids, later times."""
    later_ns = walk * _WALK_TICKS * TICK_NS
    return replace(
        snapshot,
        now_ns=snapshot.now_ns + later_ns,
        capture_ns=snapshot.capture_ns + later_ns,
        ids=tuple(i + walk * PEOPLE for i in snapshot.ids),
    )


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
    trajectory = load_trajectory("pick_and_place", model, None)
    for counter in range(_STATES):  # enough to prove its direction
        before_s = (_STATES - 1 - counter) * 0.02
        q, qd = trajectory.at_phase(_PHASES_S[which] - 0.5 * before_s, 0.5)
        state = RobotState(
            robot=which,
            mode=RobotMode.AUTOMATIC,
            counter=counter,
            positions=tuple(q.tolist()),
            velocities=tuple(qd.tolist()),
        )
        tracker.update(state, NOW_NS - round(before_s * 1e9))
    return tracker


def _walkers(tick: int) -> tuple[PeopleSnapshot, Forecast]:
    """Return people who walk to the arms at 0.5 m/s, and their true future as the forecast."""
    start = standing_body() + np.array([(*at, 0.0) for at in _PEOPLE_AT])[:, None]
    towards = -np.array([(*at, 0.0) for at in _PEOPLE_AT])
    velocity = 0.5 * towards / np.linalg.norm(towards, axis=1, keepdims=True)
    before = tick + 1 - _WALK_TICKS
    times = (np.arange(1 - STEPS, STEPS + 1) + before) / RATE_HZ
    path = start[:, None] + times[:, None, None] * velocity[:, None, None]  # (P, T + H, J, 3)
    people, now_ns = len(start), NOW_NS + before * TICK_NS
    snapshot = PeopleSnapshot(
        now_ns=now_ns,
        ids=tuple(range(people)),
        history=path[:, :STEPS],
        observed=np.ones((people, STEPS, len(JOINTS)), bool),
        capture_ns=np.full(people, now_ns - AGE_NS, np.int64),
        last_positions=path[:, STEPS - 1],
        joint_age_s=np.zeros((people, len(JOINTS))),
        lost=(),
        reasons=(),
        newest_capture_ns=now_ns - AGE_NS,
        captures=1,
        counters={},
    )
    return snapshot, Forecast(path[:, STEPS:], None)
