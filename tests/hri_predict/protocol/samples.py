"""A message that every codec's tests send."""

from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason

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
)
