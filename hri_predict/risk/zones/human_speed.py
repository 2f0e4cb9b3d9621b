"""How fast people move: measured from what was seen, and compared with what the standard assumes.

ISO 13855:2010 assumes K = 1.6 m/s for a walking body and 2.0 m/s for an upper limb. It does not
cover running and jumping (the abstract of that edition says so). So a separation by that standard
does not cover a person who is faster, and the advice has to say so.

Speeds are least-squares slopes over ``SPAN_S``: the difference of two captures would turn a few
millimetres of noise into tenths of a metre per second. A slope is the mean over the span; a person
who accelerates within it is faster for a moment.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.arrays import Bools, Floats
from hri_predict.geometry import norm
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.risk.settings import HumanLimits
from hri_predict.skeleton import Skeleton

SPAN_S = 0.2
"""Speeds are measured over this time before the newest capture."""

MARGIN_M_S = 0.4
"""Added to a fast person's speed: the slope is 0.1 s old, and a runner gains about 4 m/s2."""

_TRUNK = ("waist", "torso")
_HANDS = ("l_wrist", "l_hand", "r_wrist", "r_hand")


Velocities = tuple[Floats, Bools]
"""(P, J, 3) m/s, always finite, and (P, J) whether it was measured. It is 0 if not."""


def joint_velocities(history: Floats, observed: Bools, rate_hz: float) -> Velocities:
    """Velocity of every joint over the last ``SPAN_S`` of the history.

    Args:
        history: (P, T, J, 3) metres, as in ``PeopleSnapshot``.
        observed: (P, T, J); only these steps count.
        rate_hz: steps per second of the history.

    Returns:
        A joint is not measured if its observed steps span less than half of ``SPAN_S`` (fewer than
        two of them, or a short history).
    """
    steps = max(2, round(SPAN_S * rate_hz) + 1)
    points, seen = history[:, -steps:], observed[:, -steps:]
    seen = seen & np.isfinite(points).all(-1)
    time = np.arange(1 - points.shape[1], 1) / rate_hz  # (T,), 0 at the newest step
    weight = seen.astype(np.float64)
    count = np.maximum(weight.sum(1), 1.0)  # (P, J)
    middle = (weight * time[:, None]).sum(1) / count
    centred = weight * (time[:, None] - middle[:, None])  # (P, T, J), 0 where not seen
    spread = (centred**2).sum(1)
    slope = (centred[..., None] * np.where(seen[..., None], points, 0.0)).sum(1)
    first = np.where(seen, time[:, None], np.inf).min(1, initial=np.inf)
    last = np.where(seen, time[:, None], -np.inf).max(1, initial=-np.inf)
    measured = (last - first >= SPAN_S / 2 - 1e-9) & (spread > 0)
    velocity = slope / np.where(measured, spread, 1.0)[..., None]
    return np.where(measured[..., None], velocity, 0.0), measured


def joint_speeds(history: Floats, observed: Bools, rate_hz: float) -> tuple[Floats, Bools]:
    """(P, J) speed of every joint, m/s, and whether it was measured; see ``joint_velocities``."""
    velocity, measured = joint_velocities(history, observed, rate_hz)
    return norm(velocity), measured


def velocities_in(snapshot: PeopleSnapshot, rate_hz: float) -> Velocities:
    """``joint_velocities`` of everybody in a snapshot whose history has ``rate_hz``."""
    return joint_velocities(snapshot.history, snapshot.observed, rate_hz)


def growth_speeds(velocities: Velocities, assumed_m_s: Floats | float) -> Floats:
    """(P, J) speeds at which zones without a forecast grow: the assumed or the measured, if faster.

    Args:
        velocities: of all joints.
        assumed_m_s: (P, J), or a shape that broadcasts to it.
    """
    return np.maximum(norm(velocities[0]), assumed_m_s)


@dataclass(frozen=True, slots=True, eq=False)
class HumanSpeeds:
    """How fast P people are, m/s; 0 if it was not measured.

    Attributes:
        trunk: (P,) of waist or torso, whichever is faster. hand: (P,) of the fastest hand or wrist,
        relative to the trunk (or to the room, if the trunk's
            velocity was not measured).
        fast: (P,) whether trunk or hand is faster than the standard assumes.
    """

    trunk: Floats
    hand: Floats
    fast: Bools

    @property
    def beyond_standard_m_s(self) -> Floats:
        """(P,) v_h of people faster than the standard assumes: measured plus a margin; else 0.

        The faster of trunk and hand counts: the trunk goes on, and a hand that reaches forward may
        do so for as long as the robot takes to stop. This is our choice: the standard has no
        figure.
        """
        return np.where(self.fast, np.maximum(self.trunk, self.hand) + MARGIN_M_S, 0.0)


NOBODY = HumanSpeeds(np.zeros(0), np.zeros(0), np.zeros(0, np.bool_))
"""The speeds of nobody."""


def measure_people(velocities: Velocities, skeleton: Skeleton, limits: HumanLimits) -> HumanSpeeds:
    """How fast everybody is, by the velocities of their joints.

    In a skeleton without joints of these names, the roots count as the trunk, and nothing as hands.
    """
    roots = [j for j, parent in enumerate(skeleton.parents) if parent < 0]
    trunk = _indices(skeleton, _TRUNK) or roots
    hands = _indices(skeleton, _HANDS)
    velocity, measured = velocities
    of_trunk, of_hands = velocity.take(trunk, axis=1), velocity[:, hands]
    count = np.maximum(measured.take(trunk, axis=1).sum(1), 1)[:, None]
    mean = of_trunk.sum(1) / count  # an unmeasured joint adds 0
    relative = norm(of_hands - mean[:, None])
    hand_speed = np.where(measured[:, hands], relative, 0.0).max(1, initial=0.0)
    trunk_speed = norm(of_trunk).max(1)
    fast = (trunk_speed > limits.body_speed_m_s) | (hand_speed > limits.arm_speed_m_s)
    return HumanSpeeds(trunk_speed, hand_speed, fast)


def _indices(skeleton: Skeleton, names: Sequence[str]) -> list[int]:
    return [skeleton.joints.index(name) for name in names if name in skeleton.joints]
