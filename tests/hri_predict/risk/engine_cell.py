"""A cell with one robot and one person for the engine's tests."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hri_predict.base.arrays import Floats
from hri_predict.base.settings import Pose, Region
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.messages import Advice, OperatingMode, RobotMode, RobotState
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.engine import RiskEngine
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.types import Assessment
from hri_predict.robots.model import RobotSettings, load_robot
from hri_predict.robots.states.plausibility import StateCheck
from hri_predict.robots.tracker import RobotTracker
from hri_predict.zones.calibration import Calibration

RATE_HZ, STEPS = 25.0, 25
HISTORY = 6
"""Steps in which people have stood where they stand: enough to measure that they do not move."""
AGE_NS = 50_000_000
TICK_NS = 40_000_000
READY = (0.0, -1.2, 1.5, -1.8, -1.57, 0.0)
SETTINGS = RiskSettings(release_captures=2)
LINK = LinkSettings(name="bus", kind="can")
ROBOT = RobotSettings(name="arm", model="ur5e", room_from_robot=Pose(), max_speed_m_s=1.0)
MODEL = load_robot(ROBOT, None)
MODES = pytest.mark.parametrize("mode", ["iso", "predictive", "reactive", "fixed"])


def body(x: float, y: float = 0.0) -> Floats:
    """A standing body, arms down."""
    place = {"waist": (0.0, 1.0), "torso": (0.0, 1.2), "neck": (0.0, 1.45), "head": (0.0, 1.6)}
    place["head_top"] = (0, 1.75)
    for side, out in (("l_", 0.15), ("r_", -0.15)):
        for joint, z in (("shoulder", 1.4), ("elbow", 1.1), ("wrist", 0.85), ("hand", 0.68)):
            place[side + joint] = (out, z)
        for joint, z in (("hip", 0.95), ("knee", 0.5), ("ankle", 0.1), ("foot", 0.03)):
            place[side + joint] = (out / 2, z)
    return np.array([(x, y + place[joint][0], place[joint][1]) for joint in JOINTS], dtype=float)


class _Believing(StateCheck):
    """Believes whatever is reported: this cell's robot moves without leaving its place."""

    confirmed = True

    def take(self, *_state: Any) -> None:
        self.confirmed = True


class Cell:
    """An engine with one robot, stepped tick by tick; people stand at the given x."""

    def __init__(
        self,
        risk: RiskSettings = SETTINGS,
        zones: tuple[NamedZoneSettings, ...] = (),
        view: Region | None = None,
        robot: RobotSettings = ROBOT,
        doors: Mapping[str, Region] | None = None,
        horizon_steps: int = STEPS,
        calibration: Calibration | None = None,
    ) -> None:
        model = MODEL if robot is ROBOT else load_robot(robot, None)
        self.tracker = RobotTracker(robot, model, check=_Believing)
        budget = DelayBudget.from_settings(25.0, [LINK], 0.12)
        self.steps = horizon_steps
        self.engine = RiskEngine(
            settings=risk,
            robots=[self.tracker],
            skeleton=CANONICAL,
            absent_parts=[],
            named_zones=zones,
            field_of_view=view,
            budget=budget,
            forecast_rate_hz=RATE_HZ,
            horizon_steps=horizon_steps,
            calibration=calibration,
            doors=doors,
        )
        self.now_ns = 1_000_000_000
        self.captures = 0
        self.turn = 0.3  # rad/s of the base
        self.positions = READY
        self.said: dict[str, Any] = {}  # what RobotState says besides
        self.assessment: Assessment

    def snapshot(self, *x: float) -> PeopleSnapshot:
        people = len(x)
        last = np.array([body(v) for v in x]).reshape(people, len(JOINTS), 3)
        return PeopleSnapshot(
            now_ns=self.now_ns,
            ids=tuple(range(10, 10 + people)),
            history=np.repeat(last[:, None], HISTORY, axis=1),
            observed=np.ones((people, HISTORY, len(JOINTS)), bool),
            capture_ns=np.full(people, self.now_ns - AGE_NS, np.int64),
            last_positions=last,
            joint_age_s=np.zeros((people, len(JOINTS))),
            lost=(),
            reasons=(),
            newest_capture_ns=self.now_ns - AGE_NS,
            captures=self.captures,
            counters={},
        )

    def still(self, snapshot: PeopleSnapshot) -> Forecast:
        return Forecast(np.repeat(snapshot.last_positions[:, None], self.steps, axis=1), None)

    def step(
        self,
        *x: float,
        mode: RobotMode = RobotMode.AUTOMATIC,
        report: bool = True,
        request: OperatingMode = OperatingMode.AUTOMATIC,
        enabling: bool = False,
        **changes,
    ):
        self.now_ns += TICK_NS
        self.captures += 1
        if report:
            velocities = (self.turn, 0.0, 0.0, 0.0, 0.0, 0.0)
            state = RobotState(
                robot=0,
                mode=mode,
                counter=self.captures % 256,
                positions=self.positions,
                velocities=velocities,
                **self.said,
                request=request,
                enabling=enabling,
            )
            self.tracker.update(state, self.now_ns)
        snapshot = self.snapshot(*x)
        forecast = changes.pop("forecast", self.still(snapshot))
        reasons = changes.pop("why", ())
        self.assessment = self.engine.assess(replace(snapshot, **changes), forecast, reasons)
        return self.assessment.advices[0]

    def settle(self, *x: float, ticks: int = 70, **changes: Any) -> Advice:
        for _ in range(ticks):
            advice = self.step(*x, **changes)
        return advice
