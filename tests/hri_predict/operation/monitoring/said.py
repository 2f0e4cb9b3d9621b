"""What a healthy cell says, for tests of those who hear many."""

from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Advice, Level, NodeState, Schema, Status
from hri_predict.protocol.reasons import Reason

CLEAR = Advice(
    robot=0,
    level=Level.CLEAR,
    reason=Reason.NONE,
    speed_limit_m_s=1.0,
    separation_m=2.5,
    age_s=0.05,
)
RUNNING = Status(
    node_state=NodeState.RUNNING, reason=Reason.NONE, people=2, predictor=0, cycle=9, age_s=0.05
)
OURS = Schema(SCHEMA_VERSION, SCHEMA_HASH)
