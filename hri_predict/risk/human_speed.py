"""How fast people move: measured from what was seen, and set against what the standard assumes.

ISO 13855:2010 assumes K = 1.6 m/s of a walking body and 2.0 m/s of an upper limb; running and
jumping are outside it (the abstract of that edition says so). So whoever is seen to be faster is
outside what a separation by that standard covers, and the advice has to say it.

Speeds are slopes of least squares over ``SPAN_S``: a difference of two captures would turn a few
millimetres of noise into tenths of a metre per second. A slope is the mean over the span; who
changes speed within it is faster for a moment than it says.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.risk.kinematics import norm
from hri_predict.risk.settings import HumanLimits
from hri_predict.scene import Bools, Floats
from hri_predict.skeleton import Skeleton
from hri_predict.snapshot import PeopleSnapshot

SPAN_S = 0.2
"""Over this time before the newest capture speeds are measured."""

MARGIN_M_S = 0.4
"""Added to who is fast: the slope is that of 0.1 s ago, and a runner gains about 4 m/s2."""

_TRUNK = ("waist", "torso")
_HANDS = ("l_wrist", "l_hand", "r_wrist", "r_hand")


Velocities = tuple[Floats, Bools]
"""(P, J, 3) m/s, always finite, and (P, J) whether it was measured; else it is 0."""


def joint_velocities(history: Floats, observed: Bools, rate_hz: float) -> Velocities:
    """Velocity of every joint over the last ``SPAN_S`` of the history.

    Args:
        history: (P, T, J, 3) metres, as in ``PeopleSnapshot``.
        observed: (P, T, J); only these steps count.
        rate_hz: steps per second of the history.

    Returns:
        Not measured is a joint whose observed steps do not span half of ``SPAN_S`` (no two of them,
        a short history).
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


class SnapshotVelocities:
    """The joints' velocities in a snapshot, measured once for all who ask for them in a tick.

    Args:
        rate_hz: steps per second of the snapshots' history.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._newest: tuple[PeopleSnapshot, Velocities] | None = None

    def of(self, snapshot: PeopleSnapshot) -> Velocities:
        """As ``joint_velocities``."""
        if self._newest is None or self._newest[0] is not snapshot:
            found = joint_velocities(snapshot.history, snapshot.observed, self._rate_hz)
            self._newest = snapshot, found
        return self._newest[1]


def growth_speeds(velocities: Velocities, assumed_m_s: Floats | float) -> Floats:
    """(P, J) speeds at which zones without a forecast grow: as assumed, or as measured if faster.

    Args:
        velocities: of all joints.
        assumed_m_s: (P, J), or what broadcasts to it.
    """
    return np.maximum(norm(velocities[0]), assumed_m_s)


@dataclass(frozen=True, slots=True, eq=False)
class HumanSpeeds:
    """How fast P people are, m/s; 0 where it was not measured.

    Attributes:
        trunk: (P,) of waist or torso, the faster.
        hand: (P,) of the fastest hand or wrist, relative to the trunk (to the room, where the
            trunk's velocity was not measured).
        fast: (P,) whose trunk or hand is faster than the standard assumes.
    """

    trunk: Floats
    hand: Floats
    fast: Bools

    @property
    def beyond_standard_m_s(self) -> Floats:
        """(P,) v_h of who is faster than the standard assumes: measured plus a margin; else 0.

        The faster of trunk and hand: the trunk goes on, and a hand that is thrown forward lasts for
        as long as a robot stops. Our choice: the standard has no figure for it.
        """
        return np.where(self.fast, np.maximum(self.trunk, self.hand) + MARGIN_M_S, 0.0)


def measure_people(velocities: Velocities, skeleton: Skeleton, limits: HumanLimits) -> HumanSpeeds:
    """How fast everybody is by the velocities of their joints.

    A skeleton without joints of these names has its roots for a trunk, and no hands.
    """
    roots = [j for j, parent in enumerate(skeleton.parents) if parent < 0]
    trunk = _indices(skeleton, _TRUNK) or roots
    hands = _indices(skeleton, _HANDS)
    velocity, measured = velocities
    of_trunk, of_hands = velocity.take(trunk, axis=1), velocity[:, hands]
    count = np.maximum(measured.take(trunk, axis=1).sum(1), 1)[:, None]
    mean = of_trunk.sum(1) / count  # what was not measured is 0 in the sum
    relative = norm(of_hands - mean[:, None])
    hand_speed = np.where(measured[:, hands], relative, 0.0).max(1, initial=0.0)
    trunk_speed = norm(of_trunk).max(1)
    fast = (trunk_speed > limits.body_speed_m_s) | (hand_speed > limits.arm_speed_m_s)
    return HumanSpeeds(trunk_speed, hand_speed, fast)


def _indices(skeleton: Skeleton, names: Sequence[str]) -> list[int]:
    return [skeleton.joints.index(name) for name in names if name in skeleton.joints]
