"""Observes one person of a source: position and stillness of a joint."""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.clock import Clock, MonotonicClock
from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.scene import Scene
from hri_predict.contracts.source import Source, live_part, wait_for

LEAST_SIGHTS = 10
KEPT = 1000  # scenes whose times are kept
MOST_SPREAD_M = 0.15
"""Maximum scatter of a tracker used near a robot."""
STILL_M = 0.03
"""Maximum movement of a still joint from the first half to the second, besides its noise."""
FEET = "feet"
TOUCHING = ("r_hand", "r_wrist", "l_hand", "l_wrist")
_SIGMA_OF_MAD = 1.4826  # standard deviation of a normal distribution per median absolute deviation
_CHI_99 = 3.37  # length of a normal vector of three axes that one in a hundred passes
_MEDIAN_ERROR = 1.2533  # standard error of a median, of sigma / sqrt(n): sqrt(pi / 2)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sights:
    """Captures from a source over some seconds.

    Attributes:
        positions, observed: (n, J, 3) metres in the room as configured, (n, J); one person.
        scenes: number of scenes, with or without a person.
    """

    positions: Floats
    observed: Bools
    scenes: int

    def seen(self) -> list[str]:
        """Joints in view most of the time."""
        if not len(self.observed):
            return []
        often = self.observed.mean(axis=0) > 0.5
        return [name for name, there in zip(JOINTS, often, strict=True) if there]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SightedPoint:
    """Place of a joint: median (3,) metres, noise per axis (standard deviation), sights."""

    middle: Floats
    spread_m: float
    count: int


def choose_joint(source: Source, joint: str | None) -> str:
    """Return the touching joint, which must be one that this source can send.

    Raises:
        ConfigError: the joint does not exist, or the source's joint map has none for it.
    """
    mapped = [name for name, there in zip(JOINTS, source.joint_map.mapped, strict=True) if there]
    if joint is None:
        joint = next((name for name in TOUCHING if name in mapped), None)
        if joint is None:
            raise ConfigError(
                f"the joint map {source.joint_map.name} has neither hand nor wrist; name the "
                f"touching joint with --joint ({', '.join(mapped)})"
            )
    if joint == FEET:
        return joint
    CANONICAL.index(joint)
    if joint not in mapped:
        raise ConfigError(
            f"--joint {joint}: the joint map {source.joint_map.name} has no such joint"
            f"{nearest(joint, mapped)} (it has: {', '.join(mapped)})"
        )
    return joint


class Sensor:
    """An open source, observed for some seconds at a time.

    Attributes:
        source: the source as given.
        captured_ns, arrived_ns: times of the newest ``KEPT`` scenes of ``everybody``.
    """

    def __init__(self, source: Source, clock: Clock) -> None:
        self.source = source
        self.captured_ns: deque[int] = deque(maxlen=KEPT)
        self.arrived_ns: deque[int] = deque(maxlen=KEPT)
        self._clock = clock

    def watch(self, seconds: float) -> Sights:
        """Observe from now on; earlier scenes are dropped.

        Raises:
            ConfigError: more than one person is in view.
        """
        bodies, seen, scenes = [], [], 0
        for scene in self._scenes(seconds):
            scenes += 1
            if len(scene.people) > 1:
                raise ConfigError("more than one person is in view; leave only one")
            for person in scene.people:
                body, there = self.source.joint_map.map(person.positions, person.observed)
                bodies.append(body)
                seen.append(there)
        return Sights(positions=_bodies(bodies), observed=_flags(seen), scenes=scenes)

    def everybody(self, seconds: float) -> tuple[dict[int, tuple[Floats, Bools]], int]:
        """Observe any number of people; return each person's captures by id, and the scenes."""
        found: dict[int, tuple[list[Floats], list[Bools]]] = {}
        scenes = 0
        for scene in self._scenes(seconds):
            scenes += 1
            self.captured_ns.append(scene.stamp_ns)
            self.arrived_ns.append(self._clock.now_ns())
            for person in scene.people:
                body, there = self.source.joint_map.map(person.positions, person.observed)
                bodies, seen = found.setdefault(person.id, ([], []))
                bodies.append(body)
                seen.append(there)
        return {n: (_bodies(b), _flags(s)) for n, (b, s) in found.items()}, scenes

    def _scenes(self, seconds: float) -> Iterator[Scene]:
        """Return the scenes of the next seconds; earlier ones are dropped."""
        while self.source.poll(self._clock.now_ns()) is not None:
            pass
        end_ns = self._clock.now_ns() + round(seconds * 1e9)
        while (due_ns := self.source.next_ns()) is not None and self._clock.now_ns() < end_ns:
            wait_for(self.source, min(due_ns, end_ns), self._clock)
            while (scene := self.source.poll(self._clock.now_ns())) is not None:
                yield scene

    def trouble(self) -> str:
        """Return why a source that listens to a sender may have received nothing."""
        live = live_part(self.source)
        if live is None:
            return "the source ended"
        if live.counters.last_error is not None:
            return f"the received data was rejected: {live.counters.last_error}"
        if not live.counters.packets:
            return "no sender; start the tracker and its sender, and check host and port"
        return "no complete scene arrived"


@contextmanager
def opened(source: Source) -> Iterator[Sensor]:
    """Open a source, and close it after use."""
    clock = MonotonicClock()
    source.open(clock.now_ns())
    try:
        yield Sensor(source, clock)
    finally:
        source.close()


def _bodies(positions: list[Floats]) -> Floats:
    return np.array(positions, np.float64).reshape(-1, len(JOINTS), 3)


def _flags(observed: list[Bools]) -> Bools:
    return np.array(observed, np.bool_).reshape(-1, len(JOINTS))


def place_of(sensor: Sensor, sights: Sights, joint: str) -> SightedPoint:
    """Return the position at which ``joint`` was held.

    The median tolerates noise and outliers, but not a joint that moved.

    Raises:
        ConfigError: no sender, no person in view, the joint not in view, not still, or too noisy.
    """
    if not sights.scenes:
        raise ConfigError(f"no scene arrived: {sensor.trouble()}")
    if not len(sights.positions):
        raise ConfigError(f"{sights.scenes} scenes arrived, but no person is in view; step into it")
    points = _points(sights, joint)
    if len(points) < LEAST_SIGHTS:
        others = ", ".join(sights.seen()) or "none"
        raise ConfigError(
            f"{joint}: seen {len(points)} times in {sights.scenes} scenes; keep it in view, or "
            f"name a joint that is seen with --joint (seen now: {others})"
        )
    middle = np.median(points, axis=0)
    spread = _spread(points)
    first, second = np.array_split(points, 2)
    moved = float(norm(np.median(second, axis=0) - np.median(first, axis=0)))
    noise = (_spread(first) + _spread(second)) / 2
    explained = _CHI_99 * _MEDIAN_ERROR * noise * np.sqrt(2 / len(second))
    if spread > MOST_SPREAD_M:
        raise ConfigError(
            f"{joint}: scatters by {spread * 1e3:.0f} mm (at most {MOST_SPREAD_M * 1e3:.0f}); keep "
            f"it still, and check the tracker"
        )
    if moved > STILL_M + explained:
        raise ConfigError(f"{joint}: it moved by {moved * 1e3:.0f} mm; keep it still and repeat")
    return SightedPoint(middle=middle, spread_m=spread, count=len(points))


def _points(sights: Sights, joint: str) -> Floats:
    """(n, 3) positions of the joint; for ``feet``, the midpoint of the ankles."""
    names = ("l_ankle", "r_ankle") if joint == FEET else (joint,)
    indices = [CANONICAL.index(name) for name in names]
    there = sights.observed[:, indices].all(axis=1)
    points: Floats = sights.positions[there][:, indices].mean(axis=1)
    return points


def _spread(points: Floats) -> float:
    """Standard deviation per axis, from the median absolute deviation, which ignores outliers."""
    mads = np.median(np.abs(points - np.median(points, axis=0)), axis=0)
    return float(_SIGMA_OF_MAD * np.sqrt(np.mean(mads**2)))


# -- check --listen: do a sender's stamps run as fast as time passes? ------------------------------

TOO_SLOW = {1e9: "seconds", 1e6: "milliseconds", 1e3: "microseconds"}
"""Wrong units used instead of nanoseconds, by the missing factor."""
TOO_FAST = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
"""Wrong units used instead of seconds, by the excess factor."""
LEAST_SPAN_NS = 200_000_000
"""Minimum duration; over less, arrival in bursts makes the stamps impossible to judge."""
LEAST_STAMPS = 10
WITHIN = 3.0
"""Factor within which the two times agree: units differ by a thousand, clocks by much less."""


def stamps_remedy(captured_ns: Sequence[int], arrived_ns: Sequence[int]) -> str | None:
    """Return a problem with the stamps and its remedy, in one line; ``None`` without a problem.

    Args:
        captured_ns: the stamps, in the order of arrival.
        arrived_ns: when the scenes arrived.
    """
    if len(captured_ns) < 2:
        return None
    stamped, passed = captured_ns[-1] - captured_ns[0], arrived_ns[-1] - arrived_ns[0]
    if len(captured_ns) >= LEAST_STAMPS and stamped == 0:
        return "all stamps are alike: let the sender state the time of capture of each scene"
    if passed < LEAST_SPAN_NS:
        return None
    if stamped < 0:
        return "stamps run backwards: let the sender state the time of capture of each scene"
    pace = stamped / passed
    for factor, unit in TOO_SLOW.items():
        if _is_near(pace * factor):
            return (
                f"stamps count {unit} where nanoseconds are meant: let the sender multiply the "
                f"time of capture by {factor:,.0f}"
            )
    for factor, unit in TOO_FAST.items():
        if _is_near(pace / factor):
            return (
                f"stamps count {unit} where seconds are meant: let the sender divide the time of "
                f"capture by {factor:,.0f}"
            )
    if stamped and not _is_near(pace):
        return (
            f"stamps run {pace:.3g} times as fast as time passes: let the sender state the time "
            f"of capture of each scene"
        )
    return None


def _is_near(pace: float) -> bool:
    """Whether the stamps advance at the pace of real time."""
    return pace > 0 and abs(math.log(pace)) < math.log(WITHIN)
