"""Messages that every codec's tests send."""

from dataclasses import replace

from hri_predict.protocol.messages import (
    Advice,
    BaseMotion,
    Level,
    OperatingMode,
)
from hri_predict.protocol.reasons import Reason
from tests.messages import make_state

ADVICE = Advice(
    robot=1,
    level=Level.SLOW,
    reason=Reason.PERSON_NEAR,
    latch_id=5,
    separation_m=1.25,
    predicted_separation_m=0.4,
    time_to_breach_s=0.32,
    speed_limit_m_s=0.75,
    body_part=12,
    robot_link=6,
    echo=200,
    age_s=0.041,
    mode=OperatingMode.MUTED,
    tool=3,
)
SIX = make_state((0.0,) * 6, robot=1)
SEVEN = replace(SIX, positions=(0.5,) * 7, velocities=(0.0,) * 7)
NINE = replace(
    SIX,
    positions=(0.25,) * 9,
    velocities=(-0.5,) * 9,
    base=BaseMotion(
        x_m=1.5, y_m=-2.5, yaw_rad=0.75, vx_m_s=0.125, vy_m_s=-0.25, yaw_rate_rad_s=0.5
    ),
)
