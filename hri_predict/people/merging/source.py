"""Several sensors of one room as one source (``kind: merged``).

The captures of the first sensor that is heard set the times of the merged scenes. A scene is sent
as soon as every other sensor has a capture of that time or later, so that bodies are interpolated
between two captures and never extrapolated. The slowest sensor thus determines the age of a scene,
which its stamp shows. A sensor with a newest capture older than its ``stale_s`` is silent. The
merge does not wait for a silent sensor; the scene names it (``Scene.doubts``) and does not claim to
see the whole room.
"""

import logging
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import fields
from itertools import combinations
from pathlib import Path

import numpy as np

from hri_predict.contracts import registry
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Doubt, Person, Scene
from hri_predict.contracts.source import (
    Live,
    Source,
    SourceCounters,
    SourceSettings,
    live_part,
)
from hri_predict.people.merging.identities import Identities, OnePerson
from hri_predict.people.merging.joints import leading, merged
from hri_predict.people.merging.likeness import Seen
from hri_predict.people.merging.sensor import Sensor, View
from hri_predict.people.merging.settings import MergedSettings
from hri_predict.people.ring_buffer import NEVER
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import Body
from hri_predict.protocol.reasons import Reason


class MergedSource:
    """See ``hri_predict.contracts.source.Source``. Its joints are the canonical ones.

    Attributes:
        live: all live sensors as one; ``None`` if none is live.
        sensors: all sensors, in the configured order.
    """

    settings_model = MergedSettings

    def __init__(self, settings: MergedSettings, base_dir: Path | None = None) -> None:
        """Build all sensors; no device is opened yet.

        Raises:
            HriPredictError: one of them cannot be built; the line names it.
        """
        self.sensors = tuple(
            Sensor(name, _built(name, part, base_dir), part)
            for name, part in settings.parts.items()
        )
        sources = [sensor.source for sensor in self.sensors]
        self.joint_map = load_joint_map("canonical")
        self.rate_hz = min(source.rate_hz for source in sources)
        self.declares_noise = all(source.declares_noise for source in sources)
        lives = {s.name: live for s in self.sensors if (live := live_part(s.source)) is not None}
        self.live = AllLive(lives) if lives else None
        self._joint_apart_m = settings.joint_apart_m
        self._identities = Identities(settings.same_m, settings.apart_m)
        self._disagreement = Disagreement(settings.moved_m, settings.moved_s)
        self._time_ns = self._now_ns = NEVER
        self._sequence = -1
        self._log = DoubtLog()

    def judge_by(self, people: PeopleSettings) -> None:
        """Set the settings for judging the bodies of every sensor; call this before ``open``."""
        for sensor in self.sensors:
            sensor.judge_by(people)

    def open(self, start_ns: int) -> None:
        """Open all sensors; none stays open if one fails."""
        if self.live is not None:
            self.live.share()
        opened: list[Source] = []
        try:
            for sensor in self.sensors:
                sensor.source.open(start_ns)
                opened.append(sensor.source)
        except BaseException:
            for source in opened:
                source.close()
            raise

    def next_ns(self) -> int | None:
        """Return when a sensor may have a scene, or an awaited sensor becomes silent."""
        due = [sensor.source.next_ns() for sensor in self.sensors]
        ends = (s.newest_ns + s.stale_ns + 1 for s in self._awaited() if s.newest_ns != NEVER)
        found = [each for each in due if each is not None]
        return min([*found, *(each for each in ends if each > self._now_ns)], default=None)

    def poll(self, now_ns: int) -> Scene | None:
        """Return the oldest scene not sent yet, if every other sensor is silent or has a capture of
        that time or later."""
        self._now_ns = now_ns
        for sensor in self.sensors:
            sensor.take(now_ns)
        pace = next((s for s in self.sensors if not s.is_silent(now_ns)), None)
        if pace is None:
            return None
        time_ns = next(pace.times_after(self._time_ns), None)
        if time_ns is None:
            return None
        silent = [s for s in self.sensors if s.newest_ns < time_ns]
        if not all(sensor.is_silent(now_ns) for sensor in silent):
            return None
        return self._scene(time_ns, silent)

    def counts(self) -> dict[str, int]:
        """Return the counters of merging, and those of each sensor as ``sensor_NAME_COUNTER``."""
        found = dict(self._identities.counters)
        for sensor in self.sensors:
            found |= {f"sensor_{sensor.name}_{key}": n for key, n in sensor.counts().items()}
        return found

    def close(self) -> None:
        """Close all sensors. Safe to call twice."""
        for sensor in self.sensors:
            sensor.source.close()

    # -- merging ----------------------------------------------------------------------------------

    def _awaited(self) -> list[Sensor]:
        """Sensors for which a capture that is not yet sent is waiting."""
        times = (next(s.times_after(self._time_ns), NEVER) for s in self.sensors)
        newest_ns = max(times)
        return [s for s in self.sensors if s.newest_ns < newest_ns]

    def _scene(self, time_ns: int, silent: list[Sensor]) -> Scene:
        views = [sensor.at(time_ns, self._time_ns) for sensor in self.sensors]
        bodies = {
            Seen(number, key): body
            for number, view in enumerate(views)
            for key, body in view.bodies.items()
        }
        self._disagreement.note(time_ns, bodies)
        people, joined = self._identities.step(bodies, time_ns)
        for sensor in self.sensors:
            sensor.forget_before(time_ns)
        self._time_ns = time_ns
        self._sequence += 1
        doubts = self._doubts(views, silent)
        self._log.note(doubts, time_ns)
        return Scene(
            stamp_ns=time_ns,
            sequence=self._sequence,
            sees_room=all(view.sees_room for view in views) and not silent,
            people=tuple(self._person(person, bodies) for person in people),
            doubts=doubts,
            joined=joined,
        )

    def _person(self, person: OnePerson, bodies: dict[Seen, Body]) -> Person:
        own = {sensor: bodies[seen] for sensor, seen in person.seen.items()}
        person.lead = leading(person.lead, own)
        positions, observed, disputed, error_m = merged(person.lead, own, self._joint_apart_m)
        self._identities.counters["disputed_joints"] += disputed
        if observed.any():
            person.place = positions[observed].mean(axis=0)
        return Person(
            person.id,
            np.where(observed[:, None], positions, np.nan),
            observed,
            tuple((self.sensors[n].name, seen.key[0]) for n, seen in sorted(person.seen.items())),
            error_m,
        )

    def _doubts(self, views: list[View], silent: list[Sensor]) -> tuple[Doubt, ...]:
        names = [sensor.name for sensor in self.sensors]
        found = [
            Doubt(
                Reason.SENSOR_SILENT,
                f"sensor {sensor.name} "
                + ("was never heard" if sensor.newest_ns == NEVER else "is silent"),
            )
            for sensor in silent
        ]
        found += [
            Doubt(
                Reason.SENSORS_DISAGREE,
                f"sensors {names[one]} and {names[other]} are {apart_m * 100:.0f} cm apart",
            )
            for (one, other), apart_m in self._disagreement.apart_m().items()
        ]
        return (*found, *(doubt for view in views for doubt in view.doubts))


class AllLive:
    """All live sensors of a merged source; see ``Live``.

    Args:
        lives: live sources by the sensors' names.

    Attributes:
        arrived: set when any of them has a scene.
        stamps_utc: false: merged scenes are stamped with the node's clock.
        label: see ``Live``.
    """

    stamps_utc = False
    label = "source 'merged'"

    def __init__(self, lives: dict[str, Live]) -> None:
        self.arrived = threading.Event()
        self._lives = lives

    def share(self) -> None:
        """Let all sensors set one event, and log with their sensor's name."""
        for name, live in self._lives.items():
            live.arrived = self.arrived
            live.label = f"sensor {name}"

    @property
    def connected(self) -> bool:
        """Whether all sensors can receive."""
        return all(live.connected for live in self._lives.values())

    @property
    def counters(self) -> SourceCounters:
        """Return the sums of all sensors' counts, and the newest trouble with its sensor's name."""
        total = SourceCounters()
        for name, live in self._lives.items():
            for each in fields(SourceCounters):
                value = getattr(live.counters, each.name)
                if each.name != "last_error":
                    setattr(total, each.name, getattr(total, each.name) + value)
                elif value is not None:
                    total.note(f"sensor {name}: {value}")
        return total


def _built(name: str, settings: SourceSettings, base_dir: Path | None) -> Source:
    """One sensor's source, with its faults."""
    cls = registry.load("sources", settings.kind)
    with registry.building(f"source 'merged', sensors.{name}"):
        source = cls(settings, base_dir)
    if settings.faults:
        return registry.load("faults", "source")(source, settings.faults, seed=0)
    return source


log = logging.getLogger(__name__)

EVERY_NS = 60_000_000_000
"""Interval within which a doubt that starts again is only counted."""


class DoubtLog:
    """Logs each doubt when it starts, at most once a minute. One thread only.

    The node's log limits lines by their message template, which all doubts share: without a limit
    for each doubt, two sensors that alternately agree and disagree would hide that a third is
    silent.
    """

    def __init__(self) -> None:
        self._now: set[str] = set()
        # doubt -> when it was logged, how often it began since
        self._said: dict[str, list[int]] = {}

    def note(self, doubts: Sequence[Doubt], time_ns: int) -> None:
        """Log new doubts, counts at the end of their minute, and the end of all doubts."""
        # without the centimetres, which change
        now = {doubt.text.split(" are ")[0]: doubt.text for doubt in doubts}
        for key, (said_ns, again) in list(self._said.items()):
            if time_ns - said_ns >= EVERY_NS:
                del self._said[key]
                if again:
                    log.warning("source 'merged': %s: %d more times within a minute", key, again)
        for key in sorted(now.keys() - self._now):
            if key in self._said:
                self._said[key][1] += 1
            else:
                self._said[key] = [time_ns, 0]
                log.warning("source 'merged': %s", now[key])
        if self._now and not now:
            log.info("source 'merged': all sensors are heard and agree")
        self._now = set(now)


REACH_M = 0.8
"""Maximum distance between two bodies that are assumed to be one person."""
WELL_JOINTS = 8
"""Minimum number of joints seen by both: their centre is then accurate to about a centimetre."""
SAMPLE_NS = 100_000_000
PER_S = 10


class Disagreement:
    """Detects a moved sensor: two sensors see the same people in different places. One thread only.

    If exactly one body of each of two sensors is within ``REACH_M`` of the other, both are assumed
    here to be one person, whether merged or not. Between well-registered sensors, the centres of
    their common joints are a few centimetres apart, because trackers place joints differently from
    each side. A larger median over seconds is not noise: a sensor was moved or turned, or its pose
    or latency is wrong. Which of the two is at fault cannot be determined.

    Args:
        moved_m, moved_s: see ``MergedSettings``.
    """

    def __init__(self, moved_m: float, moved_s: float) -> None:
        self._moved_m = moved_m
        self._count = round(moved_s * PER_S)
        self._apart: dict[tuple[int, int], deque[float]] = {}
        self._next_ns: int | None = None

    def note(self, time_ns: int, bodies: Mapping[Seen, Body]) -> None:
        """Add all bodies of one time; used at most ten times a second."""
        if self._next_ns is not None and time_ns < self._next_ns:
            return
        self._next_ns = time_ns + SAMPLE_NS
        whole = {s: b for s, b in bodies.items() if np.count_nonzero(b.observed) >= WELL_JOINTS}
        for one, other in combinations(sorted({seen.sensor for seen in whole}), 2):
            samples = self._apart.setdefault((one, other), deque(maxlen=self._count))
            samples.extend(_apart_m(whole, one, other))

    def apart_m(self) -> dict[tuple[int, int], float]:
        """Pairs of sensors that disagree, with their distance in metres."""
        found = {}
        for pair, samples in self._apart.items():
            if len(samples) == self._count:
                median_m = float(np.median(samples))
                if median_m > self._moved_m:
                    found[pair] = median_m
        return found


def _apart_m(bodies: Mapping[Seen, Body], one: int, other: int) -> list[float]:
    """Return the distances of the pairs of bodies that have no other body near them."""
    ours = [body for seen, body in bodies.items() if seen.sensor == one]
    theirs = [body for seen, body in bodies.items() if seen.sensor == other]
    apart = np.full((len(ours), len(theirs)), np.inf)
    for i, body in enumerate(ours):
        for j, their in enumerate(theirs):
            both = body.observed & their.observed
            if np.count_nonzero(both) >= WELL_JOINTS:
                between = (their.positions[both] - body.positions[both]).mean(axis=0)
                apart[i, j] = float(np.linalg.norm(between))
    near = apart <= REACH_M
    alone = near & (near.sum(0) == 1) & (near.sum(1, keepdims=True) == 1)
    return [float(metres) for metres in apart[alone]]
