"""Ticks for the tests of evidence."""

import numpy as np

from hri_predict.base.geometry import Capsules
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.types import Assessment, NearMiss
from hri_predict.zones.types import Zones
from tests.messages import make_status

MS = 1_000_000


def tick(
    now_ms: float,
    *levels: Level,
    near: tuple[int, ...] = (),
    reason: Reason = Reason.PERSON_NEAR,
) -> Tick:
    """A tick of robots at these levels; ``near``: indices of robots with a near miss."""
    nobody = np.zeros((0, 1, 1, 3))
    zones = Zones((), ("l_hand",), np.zeros(1), Capsules(nobody, nobody, nobody[..., 0]))
    misses = tuple(
        NearMiss(robot=i, person=7, segment="l_hand", link=2, separation_m=0.5, limit_m=0.45)
        for i in near
    )
    advices = tuple(
        Advice(
            robot=i,
            level=level,
            reason=reason,
            latch_id=0,
            separation_m=0.4,
            predicted_separation_m=0.1,
            time_to_breach_s=None,
            speed_limit_m_s=0.0,
            body_part=None,
            robot_link=None,
        )
        for i, level in enumerate(levels)
    )
    status = make_status(cycle=0)
    return Tick(
        now_ns=round(now_ms * MS),
        status=status,
        advices=advices,
        snapshot=None,
        forecast=None,
        assessment=Assessment(advices, zones, (), (), misses),
        messages=(),
    )
