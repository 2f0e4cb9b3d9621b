"""One tracked body: its history, and the plausibility check of a new capture."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Stamps, mean_of
from hri_predict.base.skeleton import CANONICAL
from hri_predict.people.build import is_same_build
from hri_predict.people.passage import Passage
from hri_predict.people.ring_buffer import NEVER, PushResult, RingBuffer
from hri_predict.people.trail import FOUND_M_S2, SAME_ID_M_S2, Trail

_STRETCH_M = 0.75
"""Margin on ``_PARTS_M``: a stretched body's hand and foot are a metre apart on the floor."""
_PARTS_M = 0.25
"""Maximum horizontal distance, in metres, between the centres of two fragments of one body."""
_WHOLE_BODY_JOINTS = 4
"""Minimum number of common joints for a mean that describes the body, not one fast hand."""
_TRUNK = np.array(
    [
        CANONICAL.index(name)
        for name in ("waist", "torso", "neck", "l_shoulder", "r_shoulder", "l_hip", "r_hip")
    ]
)
_TRUNK_JOINTS = 3
"""Minimum number of trunk joints that describe the body without its swinging limbs."""
_LIMBS_M = 0.15
"""Error in addition to noise if no trunk is seen, because limbs move by themselves."""
_REMEMBERED_M = 0.1
"""Error in addition to noise if only other parts of the body are seen, because limbs move."""
SAME_ID_M = 0.25
"""Noise of a body from capture to capture; two people are hardly ever closer together."""
FOUND_M = 0.12
"""Noise of a body that is found again or has a new id: another person would be farther away."""
_UNMEASURED_M_S = 6.0
"""Maximum speed of a body that has been seen only once, from one capture to the next."""
_UNMEASURED_FOUND_M_S = 1.6
"""Maximum speed of a body that is found again: ISO 13855 walking speed."""
_PICTURES = 4096
"""Number of fingerprints kept: a loop of minutes is detected at its first repeat."""
_FEW_PICTURES = 8
_LEAST_JOINTS = 4
"""A body with fewer joints, in whole millimetres, may repeat by chance: it is compared only with
the newest ``_FEW_PICTURES``."""
_GLITCHES = 0.25
"""Maximum share of joints beyond the speed limit for which only those joints are noisy."""


@dataclass(frozen=True, eq=False)
class Body:
    """One body of one scene, in canonical joints: positions (J, 3) finite, 0 where not observed;
    and their common position error, see ``hri_predict.contracts.scene.Person``."""

    id: int
    positions: Floats
    observed: Bools
    error_m: float = 0.0

    @cached_property
    def centroid(self) -> Floats:
        """(3,) mean of the observed joints; at least one is observed."""
        centroid: Floats = mean_of(self.positions[self.observed])
        return centroid

    @cached_property
    def fingerprint(self) -> int:
        """Hash that bit-identical bodies share; other pairs share it by chance once in 2^60."""
        return hash((self.positions.tobytes(), self.observed.tobytes()))


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Limits of a body's motion between two captures.

    Attributes:
        joint_speed_m_s: maximum speed of any joint.
        body_speed_m_s: maximum speed of the joints' mean.
        period_ns: minimum assumed time between two captures, so that jitter of the stamps does not
            look like speed.
        refused_ns: maximum assumed time between two captures while captures are refused; otherwise
            any jump would become plausible if repeated for long enough.
    """

    joint_speed_m_s: float
    body_speed_m_s: float
    period_ns: int
    refused_ns: int


@dataclass(slots=True, eq=False, kw_only=True)
class Track:
    """A body that is tracked, or was tracked until it vanished.

    Attributes:
        id: the source's id of the body.
        history: captures of the body.
        capture_ns: newest accepted capture.
        present_ns: newest scene that contained the body, accepted or not.
        positions: (J, 3) last observed position of each joint; NaN if never.
        stamps: (J,) time of that observation; ``NEVER`` if never.
        fingerprints: fingerprints of the newest accepted bodies, each with its number, to detect
            repeats: a frozen source may send one body again and again, or a loop of any length.
        repeats: number of consecutive bit-identical captures.
        rival: track formed by the captures refused since the last accepted one; it takes over when
            enough of them agree with each other.
        captures: number of accepted captures.
        began_ns: time of the first capture.
        began_at: (3,) mean of the joints seen in the first capture.
        resumed_ns: start of uninterrupted tracking with its present id.
        passage: progress through an exit.
        trail: path of the body in the last second.
        stray_ns: last time at which a single capture with this id was elsewhere.
        strays: newest rivals that were lost beside people who were lost there before.
    """

    id: int
    history: RingBuffer
    positions: Floats
    stamps: Stamps
    capture_ns: int = NEVER
    present_ns: int = NEVER
    fingerprints: dict[int, int] = field(default_factory=dict)
    repeats: int = 0
    rival: "Track | None" = field(default=None)
    captures: int = 0
    began_ns: int = NEVER
    began_at: Floats = field(default_factory=lambda: np.zeros(3))
    resumed_ns: int = NEVER
    passage: Passage = field(default_factory=Passage)
    trail: Trail = field(default_factory=Trail)
    stray_ns: int = NEVER
    strays: "tuple[Track, ...]" = ()
    _places: Floats = field(
        default_factory=lambda: np.zeros((1, 2))
    )  # of the trail, for each joint

    @classmethod
    def start(cls, body: Body, history: RingBuffer, capture_ns: int, now_ns: int) -> "Track":
        """Return a new track with ``body`` as its first capture."""
        joints = history.joints
        track = cls(
            id=body.id,
            history=history,
            positions=np.full((joints, 3), np.nan),
            stamps=np.full(joints, NEVER),
            began_ns=capture_ns,
            resumed_ns=capture_ns,
            began_at=body.centroid,
            _places=np.zeros((joints, 2)),
        )
        track.take(body, body.observed, capture_ns, now_ns)
        return track

    @property
    def body(self) -> Body:
        """Return the newest capture."""
        return Body(self.id, self.positions, self.stamps == self.capture_ns)

    @property
    def error_m(self) -> float:
        """Largest position error of the captures in its history, metres."""
        return self.history.error_m

    @property
    def centroid(self) -> Floats:
        """(3,) mean of the joints seen in the newest capture, or of all joints ever seen."""
        recent = self.stamps == self.capture_ns
        if not recent.any():
            recent = self.stamps != NEVER
        centroid: Floats = mean_of(self.positions[recent])
        return centroid

    def apart(self, body: Body) -> float:
        """Return the distance (m) of ``body`` from the last seen position of this body.

        This is the median over the joints seen in both, or the horizontal distance if these are too
        few: means of different joints differ by half a body's height.
        """
        common = body.observed & (self.stamps == self.capture_ns)
        if np.count_nonzero(common) >= _WHOLE_BODY_JOINTS:
            moved = np.median(body.positions[common] - self.positions[common], axis=0)
            return float(np.linalg.norm(moved))
        return max(0.0, float(np.linalg.norm((body.centroid - self.centroid)[:2])) - _PARTS_M)

    def step(self, body: Body) -> tuple[Floats, float]:
        """Return the motion over the floor from this trunk to that of ``body``.

        If too few joints were seen in both, each joint is expected at its last seen position plus
        the body's motion since then. Parts never seen before are assumed near the others.

        Returns:
            (2,) metres, and its possible error in addition to noise, m.
        """
        fresh = body.observed & (self.stamps == self.capture_ns)
        if np.count_nonzero(fresh) >= _WHOLE_BODY_JOINTS:
            return _median(body.positions - self.positions, fresh)
        known = body.observed & (self.stamps != NEVER)
        if np.count_nonzero(known) >= _WHOLE_BODY_JOINTS:
            onward = self.trail.place - self._places
            step, loose_m = _median(body.positions - self.positions, known, onward)
            return step, max(loose_m, _REMEMBERED_M)
        apart = (body.centroid - self.centroid)[:2]
        floor_m = float(np.linalg.norm(apart))
        return apart * (max(floor_m - _PARTS_M, 0.0) / max(floor_m, 1e-9)), _REMEMBERED_M

    def astray(
        self, body: Body, seconds: float, *, same_id: bool, since: Trail | None = None
    ) -> tuple[float, float]:
        """Return the distance of ``body`` from the position extrapolated over ``seconds``.

        Args:
            same_id: whether ``body`` has the same id, which allows more noise.
            since: path of ``body`` since it appeared; ``None``: it has just appeared.

        Returns:
            metres, and the distance that noise and acceleration explain; -1: another id and
            different bones.
        """
        if not same_id:
            _, positions, observed = self.history.samples()
            if not is_same_build(positions, observed, body.positions, body.observed):
                return 0.0, -1.0
        step, loose_m = self.step(body)
        if since is not None:
            step = step - since.travelled
        loose_m += self.trail.slack_m(SAME_ID_M if same_id else FOUND_M)
        velocity = self.trail.velocity()
        if velocity is None:
            fastest = _UNMEASURED_M_S if same_id else _UNMEASURED_FOUND_M_S
            return float(np.linalg.norm(step)), loose_m + fastest * seconds
        by_acceleration_m = 0.5 * (SAME_ID_M_S2 if same_id else FOUND_M_S2) * seconds**2
        return float(np.linalg.norm(step - velocity * seconds)), loose_m + by_acceleration_m

    def part(
        self,
        begin_ns: int,
        end_ns: int,
        history: RingBuffer,
        follow: Callable[["Track"], None],
    ) -> "Track":
        """Return a new track of this body's captures from ``begin_ns`` to ``end_ns``, both
        included.

        Args:
            follow: function called after each capture.
        """
        stamps, positions, observed = self.history.samples()
        chosen = np.flatnonzero((stamps >= begin_ns) & (stamps <= end_ns))
        if not len(chosen):  # older than what is kept
            chosen = np.array([0])
        part: Track | None = None
        for i in chosen:
            body = Body(self.id, positions[i], observed[i], self.error_m)
            capture_ns = int(stamps[i])
            if part is None:
                part = Track.start(body, history, capture_ns, capture_ns)
                part.passage.in_room = self.passage.was_in_room and begin_ns == NEVER
            else:
                part.take(body, body.observed, capture_ns, capture_ns)
            follow(part)
        assert part is not None
        older = (part.stamps == NEVER) & (self.stamps != NEVER) & (self.stamps < part.began_ns)
        older &= self.stamps >= begin_ns
        part.positions[older], part.stamps[older] = self.positions[older], self.stamps[older]
        return part

    def moved(self, span_s: float) -> tuple[Floats, float]:
        """Return the motion of the body in the ``span_s`` before it was last seen.

        Returns:
            (3,) metres, the mean over the joints seen at both ends, and the time it took, s;
            zeros if the body was not seen twice.
        """
        moved, seconds = self._joints_moved(span_s)
        both = np.isfinite(moved).all(-1)
        if not both.any():
            return np.zeros(3), 0.0
        mean: Floats = moved[both].mean(axis=0)
        return mean, seconds

    def speeds(self, span_s: float) -> tuple[float | None, Floats]:
        """Return the speed of the body, m/s, and (J,) excess speed of each joint; over ``span_s``.

        The body's speed is ``None`` if not measured; an unmeasured joint has the speed of the body.
        The last capture may show only a foot that stands: the trunk's path counts as well.
        """
        body, seconds = self.moved(span_s)
        moved, _ = self._joints_moved(span_s)
        if seconds < span_s / 2:
            return None, np.zeros(len(moved))
        apart = np.sqrt(np.einsum("ji,ji->j", moved, moved)) / seconds
        speed = float(np.linalg.norm(body)) / seconds
        path = self.trail.velocity()
        if path is not None:
            speed = max(speed, float(np.linalg.norm(path)))
        return speed, np.maximum(np.nan_to_num(apart - speed), 0.0)

    def _joints_moved(self, span_s: float) -> tuple[Floats, float]:
        """Return (J, 3) motion of each joint, NaN if not seen at both ends, and the duration, s."""
        stamps, positions, observed = self.history.samples()
        nothing = np.full((self.history.joints, 3), np.nan)
        recent = np.flatnonzero(stamps >= self.capture_ns - round(span_s * 1e9))
        if len(recent) < 2:
            return nothing, 0.0
        first, last = recent[0], recent[-1]
        both = (observed[first] & observed[last])[:, None]
        seconds = float(stamps[last] - stamps[first]) * 1e-9
        return np.where(both, positions[last] - positions[first], nothing), seconds

    def take(self, body: Body, believed: Bools, capture_ns: int, now_ns: int) -> PushResult:
        """Append ``body``; only its ``believed`` (J,) joints are recorded as observed."""
        result = self.history.push(
            capture_ns, body.positions, believed, now_ns, error_m=body.error_m
        )
        self.present_ns = max(self.present_ns, capture_ns)
        if result is PushResult.ACCEPTED:
            is_first = self.capture_ns == NEVER
            taken = Body(body.id, body.positions, believed)
            self.trail.add(capture_ns, *((np.zeros(2), 0.0) if is_first else self.step(taken)))
            self._places[believed] = self.trail.place
            self.id = body.id
            self.capture_ns = capture_ns
            self.positions[believed] = body.positions[believed]
            self.stamps[believed] = capture_ns
            self.repeats = 0
            self.rival = None
            self.captures += 1
            self._keep(body.fingerprint)
        return result

    def _keep(self, fingerprint: int) -> None:
        self.fingerprints.pop(fingerprint, None)  # the newest come last
        self.fingerprints[fingerprint] = self.captures
        if len(self.fingerprints) > _PICTURES:
            del self.fingerprints[next(iter(self.fingerprints))]

    def has_shown(self, body: Body) -> bool:
        """Return whether bit-identical joints were accepted before."""
        number = self.fingerprints.get(body.fingerprint)
        if number is None or np.count_nonzero(body.observed) >= _LEAST_JOINTS:
            return number is not None
        return self.captures - number < _FEW_PICTURES

    def believable(self, body: Body, capture_ns: int, limits: MotionLimits) -> Bools | None:
        """Return (J,) whether observed joints of ``body`` are consistent with this track; ``None``
        if none.

        If a few joints exceed the speed limit, only those are rejected. If many do, or if the body
        as a whole moved faster than a body can, the whole capture is rejected.
        """
        common = body.observed & (self.stamps != NEVER)
        count = int(np.count_nonzero(common))
        if not count:
            elapsed_s = float(self._elapsed_s(np.array([self.capture_ns]), capture_ns, limits)[0])
            far = self.apart(body) > _STRETCH_M + limits.body_speed_m_s * elapsed_s
            return None if far else body.observed
        elapsed = self._elapsed_s(self.stamps[common], capture_ns, limits)
        velocity = (body.positions[common] - self.positions[common]) / elapsed[:, None]
        too_fast = np.einsum("ji,ji->j", velocity, velocity) > limits.joint_speed_m_s**2
        glitches = int(np.count_nonzero(too_fast))
        if glitches > _GLITCHES * count:
            return None
        if count >= _WHOLE_BODY_JOINTS:
            mean = velocity[~too_fast].mean(axis=0)
            if float(mean @ mean) > limits.body_speed_m_s**2:
                return None
        if not glitches:
            return body.observed
        believed = body.observed.copy()
        believed[np.flatnonzero(common)[too_fast]] = False
        return believed

    def _elapsed_s(self, stamps: Stamps, capture_ns: int, limits: MotionLimits) -> Floats:
        elapsed = np.maximum(capture_ns - stamps, limits.period_ns)
        if self.rival is not None:
            elapsed = np.minimum(elapsed, max(limits.period_ns, limits.refused_ns))
        seconds: Floats = elapsed * 1e-9
        return seconds


def _median(moved: Floats, seen: Bools, less: Floats | None = None) -> tuple[Floats, float]:
    """Return (2,) horizontal median of ``moved`` (J, 3) minus ``less`` (J, 2), and its error, m.

    The median is over the trunk's joints, or over all seen joints if these are few.
    """
    trunk = _TRUNK[seen[_TRUNK]]
    chosen = trunk if len(trunk) >= _TRUNK_JOINTS else np.flatnonzero(seen)
    over_floor = moved[chosen, :2] if less is None else moved[chosen, :2] - less[chosen]
    ordered = np.sort(over_floor, axis=0)  # on so few numbers much faster than np.median
    middle = 0.5 * (ordered[(len(chosen) - 1) // 2] + ordered[len(chosen) // 2])
    return middle, 0.0 if chosen is trunk else _LIMBS_M
