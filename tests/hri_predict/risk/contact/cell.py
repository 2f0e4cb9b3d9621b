"""A cell with one robot that may touch people, and bodies of which single parts are near it."""

from dataclasses import replace

import numpy as np

from hri_predict.base.geometry import Capsules
from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.link import LinkSettings
from hri_predict.risk.contact.judge import RUNGS
from hri_predict.risk.contact.judges import contact_judges, segment_limits
from hri_predict.risk.contact.limits import FOLLOWS
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.levels.advice import asked_of
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.stage import Separation
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.model import load_robot
from hri_predict.robots.tracker import RobotNow, RobotTracker
from hri_predict.zones.types import Zones
from tests.arms import arm_settings
from tests.hri_predict.risk.people_speeds import bodies_in

READY = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
ROBOT = arm_settings(room_from_robot=Pose(xyz=[0.0, 0.0, 0.75]), payload_kg=2.0, contact="allowed")
MODEL = load_robot(ROBOT, None)
LINK = LinkSettings(name="bus", kind="can", delay_s=0.03, silence_timeout_s=0.1, reaction_s=0.1)
BUDGET = DelayBudget.from_settings(25.0, [LINK], stale_s=0.12)
TIMES = np.arange(31) / 25.0
HYBRID = RiskSettings(mode="hybrid")
CONSTANTS = RobotConstants.of(RobotTracker(ROBOT, MODEL), HYBRID, BUDGET, 1.2)
SEGMENTS = {s.name: s for s in CANONICAL.segments}
LIMITS = segment_limits(HYBRID, MODEL, list(SEGMENTS), None)
TIP = MODEL.capsules(READY).a[-1]
NOWHERE = (50.0, 0.0, 1.0)


def limit_of(segment):
    return float(LIMITS.transient_m_s[list(SEGMENTS).index(segment)] / FOLLOWS)


def rung_below(speed):
    return np.floor(speed * RUNGS + 1e-9) / RUNGS


def people(*bodies, own=0.0, radius=0.05, growth=0.2):
    """People whose named segments are at the given places; all other segments are far away."""
    centre = np.empty((len(bodies), len(TIMES), len(SEGMENTS), 3))
    for p, body in enumerate(bodies):
        for s, name in enumerate(SEGMENTS):
            centre[p, :, s] = body.get(name, NOWHERE)
    size = np.broadcast_to((radius + growth * TIMES)[:, None], centre.shape[:-1])
    capsules = Capsules(centre, centre, size)
    ids = tuple(range(7, 7 + len(bodies)))
    return bodies_in(
        Zones(ids, tuple(SEGMENTS), TIMES, capsules),
        segments_m_s=np.full((len(ids), len(SEGMENTS)), own),
        as_assumed=np.zeros(len(ids), bool),
    )


def standing():
    return RobotNow(q=READY, qd=np.zeros(6), speed_m_s=0.0)


def moving(turn=0.3):
    qd = np.array([turn, 0, 0, 0, 0, 0])
    return RobotNow(q=READY, qd=qd, speed_m_s=float(MODEL.tip_speed(READY, qd)))


def stage(risk=HYBRID, fixtures=False):
    risk = (
        risk
        if fixtures
        else risk.model_copy(update={"contact": risk.contact.model_copy(update={"fixtures": []})})
    )
    constants = replace(CONSTANTS, risk=risk)
    judges = contact_judges(
        settings=risk, robots=[constants], segments=list(CANONICAL.segments), floor_m=0.0
    )
    separation = Separation(
        settings=risk,
        robots=[constants],
        named=[],
        view=None,
        times_s=TIMES,
        horizon_s=1.2,
        contact=judges,
    )
    return constants, separation


def found(bodies, robot=None, **kwargs):
    constants, separation = stage(**kwargs)
    findings = separation(bodies, [robot or standing()])
    return asked_of(constants, findings.robots[0], bodies), findings.robots[0]


def beside(x=0.25, z=0.1):
    """A place that the tip may reach, above the table."""
    return tuple(TIP + np.array([x, 0.0, z]))
