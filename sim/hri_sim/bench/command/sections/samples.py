"""One message of each kind, as a node with one robot sends them."""

from typing import Any

from hri_predict.protocol import messages as m
from hri_predict.protocol.reasons import Reason


def messages() -> list[Any]:
    """A message of each kind, with sensible values."""
    capsules = tuple(
        m.ZoneCapsule(i, (0.1 * i, 0.5, 1.0), (0.1 * i, 0.6, 1.3), 0.2) for i in range(17)
    )
    return [
        m.Status(
            node_state=m.NodeState.RUNNING,
            reason=Reason.NONE,
            people=1,
            predictor=0,
            cycle=1,
            age_s=0.03,
        ),
        m.Advice(
            robot=0,
            level=m.Level.SLOW,
            reason=Reason.PERSON_NEAR,
            latch_id=0,
            separation_m=1.2,
            predicted_separation_m=0.8,
            time_to_breach_s=0.5,
            speed_limit_m_s=0.4,
            body_part=3,
            robot_link=5,
            echo=17,
            age_s=0.03,
        ),
        m.Schema(1, 0x12345678),
        m.RobotState(
            robot=0,
            mode=m.RobotMode.AUTOMATIC,
            counter=7,
            positions=(0.1,) * 6,
            velocities=(0.2,) * 6,
        ),
        m.Acknowledge(3, 9),
        m.Zone(person=1, step=12, horizon_s=0.48, capsules=capsules, age_s=0.03),
        m.Pose(
            person=1,
            step=12,
            horizon_s=0.48,
            joints=tuple((i, 0.1 * i, 0.5, 1.0) for i in range(21)),
            age_s=0.03,
        ),
    ]
