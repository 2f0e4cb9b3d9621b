"""How fast people move, compared with what the standard assumes.

ISO 13855:2010 assumes K = 1.6 m/s for a walking body and 2.0 m/s for an upper limb. It does not
cover running and jumping (the abstract of that edition says so). So a separation by that standard
does not cover a person who is faster, and the advice has to say so.

What counts is how fast each joint moves *in the room* (``joint_speeds``), not relative to the body:
a robot meets the hand of a person who walks and reaches at the sum of both speeds. A person is
*fast* if

- a joint of the trunk or the head is surely faster than ``HumanLimits.body_speed_m_s``,
- a joint of an arm is surely faster than ``arm_speed_m_s``, or
- a joint of a leg is surely faster than ``body_speed_m_s``, and also than ``GAIT`` times the trunk
  or the trunk itself is fast.

The last one is the swing of a walk: it takes a foot past the body at up to four times the trunk's
speed, then the foot stands, and over half a second no part of the body gets ahead faster than the
trunk does (docs/decisions/fast-people.md has the figures from recordings). A kick is faster than
that, and so is any foot of a person whose trunk is not measured.

A person's speed is *unknown* if no joint of trunk or head was measured: a person who has just
appeared, or is hidden but for the limbs. Unknown is not slow: everything of that person counts at
the trunk's physical limit (``HumanLimits.reach``).

``joint_velocities`` measures on the resampled history instead, as calibrations do: speed classes
and ranges must be measured as they were calibrated.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.arrays import Bools, Floats, Ints, known_median
from hri_predict.geometry import norm
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.risk.settings import HumanLimits
from hri_predict.risk.zones.joint_speeds import JointSpeeds
from hri_predict.skeleton import Skeleton

SPAN_S = 0.2
"""Velocities are measured over this time before the newest capture."""

GAIT = 4.0
"""Legs of walking people are seldom more than this much faster than their trunk: in 0 to 4 % of the
ticks of recorded walks on even ground, in a quarter of them on uneven ground."""

MARGIN_M_S = 0.4
"""Added to a fast person's speed: the slope is 0.1 s old, and a runner gains about 4 m/s2."""


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
    """``joint_velocities`` of everybody in a snapshot whose history has ``rate_hz``.

    Those of inferred joints are not measured.
    """
    return joint_velocities(snapshot.history, snapshot.measured, rate_hz)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HumanSpeeds:
    """How fast P people are. S body segments.

    Attributes:
        fast: (P,) whether a joint is faster than the standard assumes.
        unknown: (P,) whether the body's speed could not be measured; never together with ``fast``.
        fastest_m_s: (P,) of the fastest joint that makes a person fast; 0 if none does.
        fastest_joint: (P,) index of that joint.
        beyond_standard_m_s: (P, S) v_h of the segments that are faster than the standard assumes,
            the measured speed plus a margin, and of all segments of people whose speed is unknown;
            else 0. This is our choice: the standard has no figure.
    """

    fast: Bools
    unknown: Bools
    fastest_m_s: Floats
    fastest_joint: Ints
    beyond_standard_m_s: Floats

    @property
    def within_standard(self) -> Bools:
        """(P,) whether the standard's assumption is known to hold."""
        return ~(self.fast | self.unknown)

    def of(self, people: Ints) -> "HumanSpeeds":
        """The speeds of some people, in the order of their indices."""
        return HumanSpeeds(
            fast=self.fast[people],
            unknown=self.unknown[people],
            fastest_m_s=self.fastest_m_s[people],
            fastest_joint=self.fastest_joint[people],
            beyond_standard_m_s=self.beyond_standard_m_s[people],
        )


def joined_speeds(parts: Sequence[HumanSpeeds]) -> HumanSpeeds:
    """The speeds of several groups of people as those of one."""
    return HumanSpeeds(
        fast=np.concatenate([part.fast for part in parts]),
        unknown=np.concatenate([part.unknown for part in parts]),
        fastest_m_s=np.concatenate([part.fastest_m_s for part in parts]),
        fastest_joint=np.concatenate([part.fastest_joint for part in parts]),
        beyond_standard_m_s=np.concatenate([part.beyond_standard_m_s for part in parts]),
    )


class SpeedRule:
    """Judges speeds of joints by the standard's assumption; see the module's docstring.

    Args:
        skeleton: names the joints and their parts. In a skeleton without parts, every joint counts
            as the trunk.
        limits: see ``HumanLimits``.

    Attributes:
        physical_m_s: (J,) physical limit of each joint.
    """

    def __init__(self, skeleton: Skeleton, limits: HumanLimits) -> None:
        part = np.full(len(skeleton.joints), "trunk", dtype=object)
        for name, joints in skeleton.parts.items():
            kind = name.rpartition("_")[2]
            outer = [j for j in joints if not skeleton.joints[j].endswith(("_shoulder", "_hip"))]
            if kind in ("arm", "leg"):
                part[outer] = kind
        self._trunk: Bools = np.asarray(part == "trunk")
        self._leg: Bools = np.asarray(part == "leg")
        self._assumed = np.where(part == "arm", limits.arm_speed_m_s, limits.body_speed_m_s)
        self._body_m_s = limits.body_speed_m_s
        self.physical_m_s = np.array([limits.reach[each].speed_m_s for each in part])
        self._unknown_m_s = limits.reach["trunk"].speed_m_s
        self._growth_m_s = limits.physical_speed_m_s

    def people(self, speeds: JointSpeeds, ends: tuple[Ints, Ints]) -> HumanSpeeds:
        """How fast everybody is.

        Args:
            speeds: (P, J) of the joints.
            ends: (S,) and (S,) the joints of the segments.
        """
        of_trunk = self._trunk & speeds.measured
        unknown: Bools = ~np.any(of_trunk, axis=1)
        trunk = np.where(of_trunk, speeds.speed, np.nan)
        trunk[unknown] = 0.0
        walks = ~(self._trunk & (speeds.surely > self._assumed)).any(1)
        swing = GAIT * known_median(trunk) * walks if len(trunk) else np.zeros(0)
        limit = np.where(self._leg, np.maximum(self._assumed, swing[:, None]), self._assumed)
        over: Bools = (speeds.surely > limit) & ~unknown[:, None]
        speed = np.where(over, speeds.speed, 0.0)
        counts = np.where(over, speed + MARGIN_M_S, 0.0)
        counts[unknown] = self._unknown_m_s
        return HumanSpeeds(
            fast=np.any(over, axis=1),
            unknown=unknown,
            fastest_m_s=speed.max(1, initial=0.0),
            fastest_joint=speed.argmax(1) if speed.size else np.zeros(len(speed), np.intp),
            beyond_standard_m_s=np.maximum(counts[:, ends[0]], counts[:, ends[1]]),
        )

    def lost(self, speeds_m_s: Floats, segments: int) -> HumanSpeeds:
        """How fast lost people may go on.

        Args:
            speeds_m_s: (L,) of their bodies.
            segments: S.
        """
        fast: Bools = speeds_m_s > self._body_m_s
        speed = np.where(fast, speeds_m_s, 0.0)
        return HumanSpeeds(
            fast=fast,
            unknown=np.zeros(len(fast), np.bool_),
            fastest_m_s=speed,
            fastest_joint=np.zeros(len(fast), np.intp),
            beyond_standard_m_s=np.repeat(speed[:, None], segments, axis=1),
        )

    def growth(self, speeds: JointSpeeds, unknown: Bools) -> Floats:
        """(P, J) speeds at which zones without a forecast grow.

        ``HumanLimits.physical_speed_m_s``, or the joint's own speed if that is higher; all joints
        of people whose speed is ``unknown`` (P,) grow at their physical limits.
        """
        present = np.maximum(speeds.speed, self._growth_m_s)
        return np.where(unknown[:, None], self.physical_m_s, present)
