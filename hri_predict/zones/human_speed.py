"""Speeds of people, compared with the assumptions of the standard.

ISO 13855:2010 assumes K = 1.6 m/s for a walking body and 2.0 m/s for an upper limb. It does not
cover running and jumping, as the abstract of that edition states. A separation by that standard
therefore does not cover a faster person, and the advice must report this.

The speed of each joint *in the room* (``joint_speeds``) is used, not relative to the body: the hand
of a person who walks and reaches moves at the sum of both speeds. A person is *fast* if

- a joint of the trunk or the head is surely faster than ``HumanLimits.body_speed_m_s``,
- a joint of an arm is surely faster than ``arm_speed_m_s``, or
- a joint of a leg is surely faster than ``body_speed_m_s``, and also than ``GAIT`` times the trunk
  or the trunk itself is fast.

The last condition allows for the swing of a walk: a foot passes the body at up to four times the
trunk's speed and then stands, so over half a second no part of the body moves ahead faster than the
trunk (docs/decisions/fast-people.md has the figures from recordings). A kick is faster than that,
and so is any foot of a person whose trunk is not measured.

A person's speed is *unknown* if no joint of trunk or head was measured: a person who has just
appeared, or is hidden except for the limbs. Unknown is not slow: the trunk's physical limit
(``HumanLimits.reach``) is used for all joints.

``joint_velocities`` uses the resampled history instead, because speed classes and ranges must be
measured as in the calibration.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints, known_median, plain_flags
from hri_predict.base.geometry import norm
from hri_predict.base.machine.compiled import kernel, part, plain
from hri_predict.base.skeleton import Skeleton
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.zones.joint_speeds import JointSpeeds
from hri_predict.zones.settings import HumanLimits

SPAN_S = 0.2
"""Time before the newest capture over which velocities are measured."""

PEAK_S = 1.0
"""Time for which a person who exceeded the standard's speed is not considered slow."""

GAIT = 4.0
"""Usual maximum ratio of leg to trunk speed in walking: exceeded in 0 to 4 % of the ticks of
recorded walks on even ground, and in a quarter of them on uneven ground."""

MARGIN_M_S = 0.4
"""Margin added to a fast person's speed: the slope is 0.1 s old, and a runner gains about 4
m/s2."""


Velocities = tuple[Floats, Bools]
"""(P, J, 3) m/s, always finite, and (P, J) whether it was measured; 0 if not measured."""


def joint_velocities(history: Floats, observed: Bools, rate_hz: float) -> Velocities:
    """Return the velocity of every joint over the last ``SPAN_S`` of the history.

    Args:
        history: (P, T, J, 3) metres, as in ``PeopleSnapshot``.
        observed: (P, T, J); only observed steps are used.
        rate_hz: steps per second of the history.

    Returns:
        A joint is not measured if its observed steps span less than half of ``SPAN_S`` (fewer than
        two of them, or a short history).
    """
    return _velocities(plain(history), plain_flags(observed), float(rate_hz))


def _velocities_by_arrays(history: Floats, observed: Bools, rate_hz: float) -> Velocities:
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


def _velocities_by_loops(history: Floats, observed: Bools, rate_hz: float) -> Velocities:
    people, length, joints = observed.shape
    steps = min(max(2, round(SPAN_S * rate_hz) + 1), length)
    velocity, measured = np.zeros((people, joints, 3)), np.zeros((people, joints), np.bool_)
    for p in range(people):
        for j in range(joints):
            count, middle = 0, 0.0
            first, last = inf, -inf
            for t in range(length - steps, length):
                time = (t + 1 - length) / rate_hz
                if observed[p, t, j] and _is_place(history[p, t, j]):
                    count += 1
                    middle += time
                    first, last = min(first, time), max(last, time)
            if not last - first >= SPAN_S / 2 - 1e-9:
                continue
            middle /= count
            spread = x = y = z = 0.0
            for t in range(length - steps, length):
                if observed[p, t, j] and _is_place(history[p, t, j]):
                    centred = (t + 1 - length) / rate_hz - middle
                    spread += centred * centred
                    x += centred * history[p, t, j, 0]
                    y += centred * history[p, t, j, 1]
                    z += centred * history[p, t, j, 2]
            measured[p, j] = True
            velocity[p, j, 0], velocity[p, j, 1] = x / spread, y / spread
            velocity[p, j, 2] = z / spread
    return velocity, measured


@part
def _is_place(place: Floats) -> bool:
    return isfinite(place[0]) and isfinite(place[1]) and isfinite(place[2])


_velocities = kernel(_velocities_by_loops, _velocities_by_arrays)


def joint_speeds(history: Floats, observed: Bools, rate_hz: float) -> tuple[Floats, Bools]:
    """Return (P, J) joint speeds, m/s, and whether measured; see ``joint_velocities``."""
    velocity, measured = joint_velocities(history, observed, rate_hz)
    return norm(velocity), measured


def velocities_in(snapshot: PeopleSnapshot, rate_hz: float) -> Velocities:
    """Return ``joint_velocities`` of all people in a snapshot with a history at ``rate_hz``.

    Velocities of inferred joints count as not measured.
    """
    return joint_velocities(snapshot.history, snapshot.measured, rate_hz)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HumanSpeeds:
    """Speeds of P people. S body segments.

    Attributes:
        fast: (P,) whether a joint exceeds the speed assumed by the standard.
        unknown: (P,) whether the body's speed could not be measured; never together with ``fast``.
        fastest_m_s: (P,) speed of the fastest joint that makes a person fast; 0 if none does.
        fastest_joint: (P,) index of that joint.
        beyond_standard_m_s: (P, S) v_h, the measured speed plus a margin, for segments that exceed
            the standard's speed and for all segments of people whose speed is unknown; 0 otherwise.
            This is our choice: the standard gives no figure.
    """

    fast: Bools
    unknown: Bools
    fastest_m_s: Floats
    fastest_joint: Ints
    beyond_standard_m_s: Floats

    @property
    def within_standard(self) -> Bools:
        """(P,) whether the standard's assumption certainly holds."""
        return ~(self.fast | self.unknown)

    def of(self, people: Ints) -> "HumanSpeeds":
        """Return the speeds of some people, in the order of the given indices."""
        return HumanSpeeds(
            fast=self.fast[people],
            unknown=self.unknown[people],
            fastest_m_s=self.fastest_m_s[people],
            fastest_joint=self.fastest_joint[people],
            beyond_standard_m_s=self.beyond_standard_m_s[people],
        )


def joined_speeds(parts: Sequence[HumanSpeeds]) -> HumanSpeeds:
    """Return the speeds of several groups of people as one group."""
    return HumanSpeeds(
        fast=np.concatenate([part.fast for part in parts]),
        unknown=np.concatenate([part.unknown for part in parts]),
        fastest_m_s=np.concatenate([part.fastest_m_s for part in parts]),
        fastest_joint=np.concatenate([part.fastest_joint for part in parts]),
        beyond_standard_m_s=np.concatenate([part.beyond_standard_m_s for part in parts]),
    )


class Moving(NamedTuple):
    """Speeds of P people and of their joints and segments. J joints, S segments.

    Attributes:
        people: see ``HumanSpeeds``.
        growth_m_s: (P, J) speeds at which zones without a forecast grow:
            ``HumanLimits.physical_speed_m_s``, or the joint's own speed if higher; the physical
            limits if a person's speed is unknown.
        segments_m_s: (P, S) speed of each segment's faster end; infinite if unknown. For an
            inferred hand or foot, the physical limit is used.
    """

    people: HumanSpeeds
    growth_m_s: Floats
    segments_m_s: Floats


class _Rule(NamedTuple):
    """Values of a ``SpeedRule`` for loops and arrays; (J,) each, except for the last two."""

    trunk: Bools
    leg: Bools
    assumed: Floats
    physical: Floats
    ends: Bools  # joints that no other hangs on
    unknown_m_s: float
    growth_m_s: float


_Found = tuple[Bools, Bools, Floats, Ints, Floats, Floats, Floats]
"""The fields of ``HumanSpeeds``, then ``growth_m_s`` and ``segments_m_s``."""


class SpeedRule:
    """Compares joint speeds with the standard's assumption; see the module's docstring.

    Args:
        skeleton: names the joints and their parts. In a skeleton without parts, every joint counts
            as the trunk.
        limits: see ``HumanLimits``.
    """

    def __init__(self, skeleton: Skeleton, limits: HumanLimits) -> None:
        kind = np.full(len(skeleton.joints), "trunk", dtype=object)
        for name, joints in skeleton.parts.items():
            limb = name.rpartition("_")[2]
            outer = [j for j in joints if not skeleton.joints[j].endswith(("_shoulder", "_hip"))]
            if limb in ("arm", "leg"):
                kind[outer] = limb
        self._body_m_s = limits.body_speed_m_s
        physical = np.array([limits.reach[each].speed_m_s for each in kind])
        self._rule = _Rule(
            trunk=np.asarray(kind == "trunk"),
            leg=np.asarray(kind == "leg"),
            assumed=np.where(kind == "arm", limits.arm_speed_m_s, limits.body_speed_m_s),
            physical=physical,
            ends=~np.isin(np.arange(len(kind)), skeleton.parents),
            unknown_m_s=float(limits.reach["trunk"].speed_m_s),
            growth_m_s=float(limits.physical_speed_m_s),
        )

    def moving(self, speeds: JointSpeeds, shown: Bools, ends: tuple[Ints, Ints]) -> Moving:
        """Return the speeds of all people and of their joints and segments.

        Args:
            speeds: (P, J) speeds of the joints.
            shown: (P, J) the joints that are not inferred; only these decide whether a person is
                fast.
            ends: (S,) and (S,) the joints at both ends of each segment.
        """
        joints = speeds.speed, speeds.surely, speeds.measured
        found = _moving(joints, shown, self._rule, ends)
        people = HumanSpeeds(
            fast=found[0],
            unknown=found[1],
            fastest_m_s=found[2],
            fastest_joint=found[3],
            beyond_standard_m_s=found[4],
        )
        return Moving(people, found[5], found[6])

    def peaked(self, history: Floats, measured: Bools, rate_hz: float) -> Bools:
        """Return (P,) whether trunk or head exceeded the assumed speed in the last ``PEAK_S``.

        Args:
            history: (P, T, J, 3) metres.
            measured: (P, T, J).
            rate_hz: steps per second of the history.
        """
        span = max(1, round(SPAN_S * rate_hz))
        kept = min(history.shape[1], round(PEAK_S * rate_hz) + 1)
        if kept <= span:
            return np.zeros(len(history), np.bool_)
        places, seen = history[:, -kept:], measured[:, -kept:]
        moved = norm(places[:, span:] - places[:, :-span]) * (rate_hz / span)
        over = (moved > self._rule.assumed) & seen[:, span:] & seen[:, :-span] & self._rule.trunk
        found: Bools = np.asarray(over.any(axis=(1, 2)))
        return found

    def lost(self, speeds_m_s: Floats, segments: int) -> HumanSpeeds:
        """Return the maximum speeds of lost people.

        Args:
            speeds_m_s: (L,) speeds of their bodies.
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


def _moving_by_arrays(
    joints: tuple[Floats, Floats, Bools], shown: Bools, rule: _Rule, ends: tuple[Ints, Ints]
) -> _Found:
    every_speed, surely, measured = joints
    surely = surely * shown
    of_trunk = rule.trunk & measured & shown
    unknown: Bools = ~np.any(of_trunk, axis=1)
    trunk = np.where(of_trunk, every_speed, np.nan)
    trunk[unknown] = 0.0
    walks = ~(rule.trunk & (surely > rule.assumed)).any(1)
    middle = known_median(trunk) if len(trunk) else np.zeros(0)
    swing = GAIT * middle * walks
    limit = np.where(rule.leg, np.maximum(rule.assumed, swing[:, None]), rule.assumed)
    over: Bools = (surely > limit) & ~unknown[:, None]
    speed = np.where(over, every_speed, 0.0)
    counts = np.where(over, speed + MARGIN_M_S, 0.0)
    counts[unknown] = rule.unknown_m_s
    present = np.maximum(every_speed, rule.growth_m_s)
    # a hidden joint goes along with the body
    present = np.where(shown, present, np.maximum(present, middle[:, None]))
    moves = np.where(measured, every_speed, np.inf)
    # an inferred hand follows its forearm, a true one may turn about its wrist
    moves = np.where(measured & ~shown & rule.ends, rule.physical, moves)
    return (
        np.any(over, axis=1),
        unknown,
        speed.max(1, initial=0.0),
        speed.argmax(1) if speed.size else np.zeros(len(speed), np.intp),
        np.maximum(counts[:, ends[0]], counts[:, ends[1]]),
        np.where(unknown[:, None], rule.physical, present),
        np.maximum(moves[:, ends[0]], moves[:, ends[1]]),
    )


def _moving_by_loops(
    joints: tuple[Floats, Floats, Bools], shown: Bools, rule: _Rule, ends: tuple[Ints, Ints]
) -> _Found:
    speed, surely, measured = joints
    people, count = speed.shape
    segments = len(ends[0])
    fast, unknown = np.zeros(people, np.bool_), np.zeros(people, np.bool_)
    fastest, fastest_joint = np.zeros(people), np.zeros(people, np.intp)
    beyond, moves = np.empty((people, segments)), np.empty((people, segments))
    growth, trunk = np.empty((people, count)), np.empty(count)
    counts, own = np.empty(count), np.empty(count)
    for p in range(people):
        known, walks = 0, True
        for j in range(count):
            if rule.trunk[j] and shown[p, j]:
                walks = walks and not surely[p, j] > rule.assumed[j]
                if measured[p, j]:
                    trunk[known] = speed[p, j]
                    known += 1
        unknown[p] = known == 0
        swing, middle = 0.0, 0.0
        if known:
            rising = np.sort(trunk[:known])
            middle = (rising[(known - 1) // 2] + rising[known // 2]) / 2
        if walks:
            swing = GAIT * middle
        for j in range(count):
            limit = max(rule.assumed[j], swing) if rule.leg[j] else rule.assumed[j]
            over = shown[p, j] and surely[p, j] > limit and not unknown[p]
            counts[j] = speed[p, j] + MARGIN_M_S if over else 0.0
            growth[p, j] = max(speed[p, j], rule.growth_m_s)
            if not shown[p, j]:  # a hidden joint goes along with the body
                growth[p, j] = max(growth[p, j], middle)
            if unknown[p]:
                counts[j], growth[p, j] = rule.unknown_m_s, rule.physical[j]
            if over:
                fast[p] = True
                if speed[p, j] > fastest[p]:
                    fastest[p], fastest_joint[p] = speed[p, j], j
            own[j] = speed[p, j] if measured[p, j] else inf
            if measured[p, j] and not shown[p, j] and rule.ends[j]:
                own[j] = rule.physical[j]
        for s in range(segments):
            beyond[p, s] = max(counts[ends[0][s]], counts[ends[1][s]])
            moves[p, s] = max(own[ends[0][s]], own[ends[1][s]])
    return fast, unknown, fastest, fastest_joint, beyond, growth, moves


_moving = kernel(_moving_by_loops, _moving_by_arrays)
