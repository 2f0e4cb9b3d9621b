"""Messages of a node with one robot, with sensible values."""

from dataclasses import replace
from typing import Any

from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    Message,
    NodeState,
    Pose,
    RobotMode,
    RobotState,
    Schema,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason

STEPS = 3  # horizons that a node sends
CYCLES = 256  # the modulus of Status.cycle on the wire
ADVICE = Advice(
    robot=0,
    level=Level.SLOW,
    reason=Reason.PERSON_NEAR,
    latch_id=0,
    separation_m=1.2,
    predicted_separation_m=0.8,
    time_to_breach_s=0.5,
    speed_limit_m_s=0.4,
    body_part=3,
    robot_link=5,
    echo=17,
)
STATUS = Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=1, predictor=0, cycle=1)
SCHEMA = Schema(SCHEMA_VERSION, SCHEMA_HASH)
ZONE = Zone(
    person=1,
    step=0,
    horizon_s=0.0,
    capsules=tuple(
        ZoneCapsule(i, (0.1 * i, 0.5, 1.0), (0.1 * i, 0.6, 1.3), 0.2) for i in range(17)
    ),
)
POSE = Pose(
    person=1, step=0, horizon_s=0.0, joints=tuple((i, 0.1 * i, 0.5, 1.0) for i in range(21))
)


def one_of_each() -> list[Message]:
    """Return a message of each kind, as a node with one robot sends and receives them."""
    robot_state = RobotState(
        robot=0,
        mode=RobotMode.AUTOMATIC,
        counter=7,
        positions=(0.1,) * 6,
        velocities=(0.2,) * 6,
    )
    later: dict[str, Any] = {"step": 12, "horizon_s": 0.48}
    return [
        *(replace(message, age_s=0.03) for message in (STATUS, ADVICE)),
        SCHEMA,
        robot_state,
        Acknowledge(3, 9),
        *(replace(message, age_s=0.03, **later) for message in (ZONE, POSE)),
    ]


def of_a_cycle(cycle: int, now_ns: int, people: int = 1) -> list[Message]:
    """Return a cycle's messages of a node with one robot, in order; the Schema once a second."""
    messages: list[Message] = [
        replace(ADVICE, capture_ns=now_ns),
        replace(STATUS, people=people, cycle=cycle, capture_ns=now_ns),
    ]
    if cycle % 25 == 0:
        messages.append(SCHEMA)
    for person in range(people):
        for step in range(STEPS):
            where: dict[str, Any] = {"person": person, "step": step, "horizon_s": 0.4 * step}
            where["capture_ns"] = now_ns
            messages += [replace(ZONE, **where), replace(POSE, **where)]
    return messages
