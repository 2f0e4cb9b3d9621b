"""Detects bodies that a tracker makes up: frozen, coasting, looped, or without a position.

A tracker that lost a person may continue to send a body: the last skeleton with fresh noise, the
last motion extrapolated, or the last second repeated. Such data show what real bodies never do:

- *frozen*: all joints stop from one capture to the next, in the middle of a step. Real bodies slow
  down.
- *coasting*: the body moves over the floor without a change of its shape, or every joint keeps its
  velocity. Real legs swing.
- *looped*: captures are repeated, with a jump in between.
- *about the hips*: see ``relative``.

A body that was already standing still and a trunk without legs prove nothing. A detected sign stays
in force until limbs move again.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Stamps, mean_of, median
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.body.relative import hips_are_origin
from hri_predict.people.ring_buffer import NEVER
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import Body

CAPTURES = 130
"""Number of captures kept for each person: two of the longest loops."""
LONGEST_LOOP = 62
"""Number of captures in the longest noisy loop; ``Track.fingerprints`` finds bit-identical
loops."""
FREEZE_S, COAST_S, RELATIVE_S = 0.17, 0.5, 2.0
AWAKE_S, LOOP_S = 0.5, 2.5
"""Minimum time for which limbs must have moved since the newest sign or, for a loop, since its
jump."""
FINEST_S = 1 / 30
"""Minimum time over which stops and jumps are judged: in less time, a gently slowing body cannot be
distinguished from a standing one, and noise alone looks like a jump.
"""
STILL_JOINTS, COAST_JOINTS = 8, 8
MOST_NOISE_M = 0.02
"""Maximum noise (standard deviation per axis) at which bodies are judged."""
LOOP_NOISE_M = 0.012
"""Maximum noise for the detection of loops, and minimum standard deviation of the motion in a
loop."""
STILL_M, RIGID_M, ALIVE_M = 0.0015, 0.002, 0.005
WHITE = 1.5
"""Maximum ratio of total variance to variance from differences for pure noise: 1 plus scatter."""
MERE_NOISE = 1.3
"""As ``WHITE``, for the longer span of a coasting body."""
SLOWING_M_S2 = 8.0
"""Maximum deceleration of a whole body: a sprinter's hardest stop."""
LEAST_M_S = 0.12
TURNING_M = 0.02
"""Maximum change of a joint's step from capture to capture: a foot at 18 m/s2 at 30 Hz. A quarter
of the joints may exceed it."""
COASTED_M = 0.1
"""Minimum distance moved by a gliding body in ``COAST_S``."""
EVEN = 3.5
"""Ratio of peak to average speed that separates a gliding body (below) from a jumping one
(above)."""
LINEAR_S, LINEAR_M = 1.0, 0.6
"""Minimum time and distance over which joints must keep their velocity: nearly a walking step. A
slow shift of weight over planted feet is shorter."""
JUMP_M_S2 = 40.0
FORGET_NS = 5_000_000_000
INHERIT_M = 0.5
_LEGS = [JOINTS.index(f"{side}_{name}") for side in "lr" for name in ("knee", "ankle", "foot")]


class Sign(Enum):
    """Sign that a body is not real; the value is the name of its counter."""

    FROZEN = "frozen_bodies"
    COASTING = "coasting_bodies"
    LOOPED = "looped_bodies"
    RELATIVE = "hip_relative_bodies"


@dataclass(slots=True)
class _Record:
    """The newest captures of one person, and the signs found in them.

    Captures are stored in arrays of twice the length, so that the newest are contiguous:
    ``stamps``, ``positions`` (n, J, 3) and ``observed`` (n, J) are views of the kept captures.
    """

    all_stamps: Stamps = field(default_factory=lambda: np.zeros(2 * CAPTURES, np.int64))
    all_positions: Floats = field(default_factory=lambda: np.zeros((2 * CAPTURES, len(JOINTS), 3)))
    all_observed: Bools = field(
        default_factory=lambda: np.zeros((2 * CAPTURES, len(JOINTS)), np.bool_)
    )
    end: int = 0
    newest_ns: int = NEVER
    stamps: Stamps = field(init=False)
    positions: Floats = field(init=False)
    observed: Bools = field(init=False)
    prints: deque[int] = field(default_factory=lambda: deque(maxlen=CAPTURES))
    middle: Floats = field(default_factory=lambda: np.zeros(3))
    relative: bool = False
    relative_ns: int = NEVER
    lag: int = 0
    again: int = 0
    sign: Sign | None = None
    sign_ns: int = NEVER

    def add(self, capture_ns: int, body: Body) -> None:
        """Keep one more capture."""
        if self.end == 2 * CAPTURES:
            self.end = CAPTURES - 1
            self.all_stamps[: self.end] = self.all_stamps[-self.end :]
            self.all_positions[: self.end] = self.all_positions[-self.end :]
            self.all_observed[: self.end] = self.all_observed[-self.end :]
        self.all_stamps[self.end] = capture_ns
        self.all_positions[self.end] = body.positions
        self.all_observed[self.end] = body.observed
        self.end += 1
        self.newest_ns, self.middle = capture_ns, body.centroid
        kept = slice(max(self.end - CAPTURES, 0), self.end)
        self.stamps, self.positions = self.all_stamps[kept], self.all_positions[kept]
        self.observed = self.all_observed[kept]

    def last(self, count: int) -> tuple[Floats, Floats, Bools]:
        """Return seconds (n,), positions (n, m, 3) of m joints seen in all captures, their
        indices."""
        always: Bools = np.logical_and.reduce(self.observed[-count:])
        stamps: Floats = np.multiply(self.stamps[-count:] - self.newest_ns, 1e-9)
        return stamps, self.positions[-count:, always], always

    def within(self, seconds: float) -> int:
        """Return the number of captures in the newest ``seconds``."""
        since = self.newest_ns - round(seconds * 1e9)
        return len(self.stamps) - int(np.searchsorted(self.stamps, since))


class MadeUpWatch:
    """Detects signs in the bodies of one source. One thread only.

    Args:
        settings: without posture checks, bodies may have any shape and gait, and are not judged.
        origin: (3,) origin of the source, in the room.
        period_ns: the source's nominal time between captures.
    """

    def __init__(self, settings: PeopleSettings, origin: Floats, period_ns: int) -> None:
        self._on = settings.posture_unchecked is None
        self._origin = origin
        self._period_s = period_ns * 1e-9
        self._freeze = max(5, round(FREEZE_S / self._period_s) + 1)
        self._stride = max(1, round(FINEST_S / self._period_s))
        self._records: dict[int, _Record] = {}

    def known_first(self, people: Iterable[Person]) -> list[Person]:
        """Return the people of a scene, known ids first, as they must be judged.

        Otherwise a new id near a body that is in the scene, too, would take over its record.
        """
        return sorted(people, key=lambda person: person.id not in self._records)

    def judge(self, body: Body, capture_ns: int, hip_centred: bool = False) -> Sign | None:
        """Add one body, and return the sign that it is made up, if any.

        Args:
            body: body in the room frame.
            capture_ns: rises from call to call.
            hip_centred: its waist was sent at exactly the source's origin.
        """
        if not self._on:
            return None
        record = self._record(body, capture_ns)
        record.add(capture_ns, body)
        self._count_again(record, body.fingerprint)
        if capture_ns - record.relative_ns >= RELATIVE_S * 1e9 / 8:
            record.relative_ns = capture_ns
            record.relative = self._is_relative(record)
        if hip_centred or record.relative:
            return Sign.RELATIVE
        found = self._sign(record)
        if found is not None:
            if record.sign is None or found is Sign.LOOPED:
                record.sign = found
            record.sign_ns = capture_ns
        elif record.sign is not None and self._awake(record):
            record.sign = None
        return record.sign

    def _record(self, body: Body, capture_ns: int) -> _Record:
        """Return the record of a body, or of one that was at this place with another id."""
        record = self._records.get(body.id)
        if record is not None and capture_ns - record.newest_ns <= FORGET_NS:
            return record
        for other, old in list(self._records.items()):
            if capture_ns - old.newest_ns > FORGET_NS:
                del self._records[other]
            elif old.newest_ns < capture_ns and (
                float(np.linalg.norm(old.middle - body.centroid)) < INHERIT_M
            ):
                record = self._records[body.id] = self._records.pop(other)
                return record
        record = self._records[body.id] = _Record()
        return record

    def _is_relative(self, record: _Record) -> bool:
        count = record.within(RELATIVE_S)
        if record.newest_ns - record.stamps[-count] < RELATIVE_S * 1e9 / 2:
            return False
        return hips_are_origin(record.positions[-count:], record.observed[-count:], self._origin)

    def _count_again(self, record: _Record, fingerprint: int) -> None:
        """Count consecutive captures that repeat those of one loop length ago."""
        lag = 0
        if fingerprint in record.prints:
            lag = len(record.prints) - max(
                k for k, print_ in enumerate(record.prints) if print_ == fingerprint
            )
        record.again = record.again + 1 if lag > 1 and lag == record.lag else int(lag > 1)
        record.lag = lag
        record.prints.append(fingerprint)

    def _sign(self, record: _Record) -> Sign | None:
        if record.again >= self._freeze or self._loops(record):
            return Sign.LOOPED
        if self._froze(record):
            return Sign.FROZEN
        return Sign.COASTING if self._coasts(record) else None

    def _froze(self, record: _Record) -> bool:
        """Return whether all joints stopped between two captures, ``_freeze`` captures ago."""
        count = self._freeze
        held = count + 3 * self._stride
        if len(record.stamps) < held or not self._is_still(record):
            return False
        stamps, joints, always = record.last(held)
        if always.sum() < STILL_JOINTS:
            return False
        after = joints[-count:]
        noise2 = _white(after)
        if noise2 > MOST_NOISE_M**2 or _variance(after) > WHITE * noise2 + STILL_M**2:
            return False
        rows = [-count - back * self._stride for back in (3, 2, 1)]
        return _stops_dead(
            stamps[-count] - stamps[rows],
            joints[rows],
            mean_of(after),
            noise_m=float(np.sqrt(noise2)),
        )

    def _is_still(self, record: _Record) -> bool:
        """Return whether the body has not moved, from a comparison of both ends of the span."""
        common = record.observed[-1] & record.observed[-self._freeze]
        if not common.any():
            return False
        moved = (record.positions[-1] - record.positions[-self._freeze])[common]
        return float((moved * moved).sum()) < 3 * MOST_NOISE_M**2 * moved.size

    def _coasts(self, record: _Record) -> bool:
        """Return whether the body moves without changing shape, or all joints keep their
        velocity."""
        count = record.within(COAST_S)
        if count < 6 or record.newest_ns - record.stamps[-count] < 0.8 * COAST_S * 1e9:
            return False
        ends = (record.positions[-count], record.positions[-1])
        common = record.observed[-count] & record.observed[-1]
        if common.sum() < COAST_JOINTS:
            return False
        way_m = float(norm(mean_of((ends[1] - ends[0])[common])))
        if way_m < COASTED_M:
            return False
        stamps, joints, always = record.last(count)
        if always.sum() < COAST_JOINTS or always[_LEGS].sum() < 2 or _leaps(stamps, joints):
            return False
        shape = joints - mean_of(joints, 1)[:, None]
        if _is_noise(shape, RIGID_M) and _is_noise(
            shape[:, np.isin(np.flatnonzero(always), _LEGS)], RIGID_M
        ):
            return True
        return way_m > LINEAR_M * COAST_S / LINEAR_S and self._keeps_velocities(record)

    def _keeps_velocities(self, record: _Record) -> bool:
        """Return whether each leg joint kept its velocity for at least a step."""
        count = record.within(LINEAR_S)
        stamps, joints, always = record.last(count)
        legs = joints[:, np.isin(np.flatnonzero(always), _LEGS)]
        if legs.shape[1] < 2:
            return False
        way_m = np.linalg.norm((joints[-1] - joints[0]).mean(axis=0))
        if stamps[0] > -0.8 * LINEAR_S or way_m < LINEAR_M:
            return False
        centred = stamps - stamps.mean()
        slope = np.tensordot(centred, legs, axes=1) / (centred @ centred)
        return _is_noise(legs - centred[:, None, None] * slope, RIGID_M)

    def _loops(self, record: _Record) -> bool:
        """Return whether captures are repeated with noise, with a jump in between."""
        held = len(record.stamps)
        if held < 2 * self._freeze or not self._jumps(record):
            return False
        _, joints, always = record.last(held)
        if always.sum() < STILL_JOINTS:
            return False
        for lag in range(2, min(LONGEST_LOOP, held // 2) + 1):
            count = max(lag, self._freeze)
            if count + lag > held:
                continue
            now, then = joints[-count:], joints[-count - lag : held - lag]
            same = ((now - then) ** 2).mean(axis=(1, 2)).max() < 2 * LOOP_NOISE_M**2
            if same and _variance(joints[-max(lag, 3) :]) > LOOP_NOISE_M**2:
                return True
        return False

    def _jumps(self, record: _Record) -> bool:
        """Return whether a recent capture jumps farther than a body can move."""
        _, joints, always = record.last(self._freeze + 2)
        if not always.any():
            return False
        turn = norm(_turns(mean_of(joints, 1)))
        return bool(turn.max() > JUMP_M_S2 * max(self._period_s, FINEST_S) ** 2)

    def _awake(self, record: _Record) -> bool:
        """Return whether limbs have moved beyond noise since the sign."""
        hold_s = LOOP_S if record.sign is Sign.LOOPED else AWAKE_S
        if record.newest_ns - record.sign_ns < hold_s * 1e9:
            return False
        count = min(record.within(AWAKE_S), self._freeze * 3)
        _, joints, always = record.last(count)
        if always.sum() < STILL_JOINTS or count < 4:
            return True  # too little is seen to say anything
        shape = joints - mean_of(joints, 1)[:, None]
        return bool(_variance(shape) > 2 * WHITE * _white(shape) + ALIVE_M**2)


def _leaps(stamps: Floats, joints: Floats) -> bool:
    """Return whether most motion of (n, m, 3) is a jump: a glitch, or another body with this id."""
    middle = mean_of(joints, 1)
    fastest = (norm(middle[1:] - middle[:-1]) / (stamps[1:] - stamps[:-1])).max()
    mean = np.linalg.norm(middle[-1] - middle[0]) / (stamps[-1] - stamps[0])
    return bool(fastest > EVEN * mean)


def _white(values: Floats) -> float:
    """Return the variance of white noise in (n, ...), by second differences, small in motion."""
    turns = _turns(values)
    return float((turns * turns).sum()) / turns.size / 6.0 if turns.size else math.nan


def _turns(values: Floats) -> Floats:
    """Return second differences of (n, ...); ``numpy.diff`` takes several times as long."""
    steps = values[1:] - values[:-1]
    turns: Floats = steps[1:] - steps[:-1]
    return turns


def _variance(values: Floats) -> float:
    """Return the mean variance over time of (n, ...)."""
    off = values - mean_of(values)
    off *= off
    return float(off.sum(axis=0).sum()) / max(len(values) - 1, 1) / max(off[0].size, 1)


def _is_noise(values: Floats, floor_m: float) -> bool:
    noise2 = _white(values)
    return noise2 < MOST_NOISE_M**2 and _variance(values) < MERE_NOISE * noise2 + floor_m**2


def _stops_dead(since_s: Floats, joints: Floats, stopped: Floats, *, noise_m: float) -> bool:
    """Return whether a body was too fast for the stop that followed.

    Args:
        since_s: (3,) seconds from each of three captures to the stop, longest first.
        joints: (3, m, 3) positions in these captures.
        stopped: (m, 3) positions since the stop.
        noise_m: standard deviation per axis.
    """
    fast = False
    for seconds, then in zip(since_s, joints, strict=True):
        way = norm(stopped - then)
        least = LEAST_M_S * seconds + SLOWING_M_S2 * seconds**2 / 2 + 3.1 * noise_m
        fast |= median(way) > least
    if not fast:
        return False
    step, before, earlier = stopped - joints[2], joints[2] - joints[1], joints[1] - joints[0]
    part = min(max(float((step * before).sum() / max((before**2).sum(), 1e-12)), 0.0), 1.0)
    # a jump, of the body or of limbs that snap to their rest, is not a motion that was cut off
    return all(_goes_on(turn, noise_m) for turn in (step - part * before, before - earlier))


def _goes_on(turn: Floats, noise_m: float) -> bool:
    """Return whether few joints change their step, by ``turn`` (m, 3), by more than limbs can."""
    turned = norm(turn) > TURNING_M + 4.5 * noise_m
    return bool(turned.sum() <= 0.25 * len(turned))
