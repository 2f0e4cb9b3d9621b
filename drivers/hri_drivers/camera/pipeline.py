"""Turns images into scenes, one at a time, always the newest."""

import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from hri_drivers.camera.faults import FrozenWatch, hides
from hri_drivers.camera.moved import MovedWatch
from hri_drivers.camera.network.found import Finder, Finding
from hri_drivers.camera.newest import Newest
from hri_drivers.camera.place.camera import Camera
from hri_drivers.camera.placing import Placer
from hri_drivers.camera.seen import Image, Seen
from hri_drivers.camera.sending import Sender
from hri_drivers.camera.times import BLIND_PERIOD_S, SceneTimes
from hri_drivers.camera.tracking import Tracker
from hri_drivers.sources.sent import SentPerson

SILENT_S, MAX_SILENT_S, INTERVALS = 0.2, 2.0, 2.5
"""Time without an image after which scenes report that the room is not seen. If images arrive
seldom, the time is this many intervals between images, up to the maximum."""


@dataclass(slots=True)
class Counts:
    """Events since the start.

    Attributes:
        pictures: number of images taken from the input.
        skipped: number of these images dropped to keep the maximum rate.
        blind: number of scenes without a view of the room, by reason.
        most_people: maximum number of people in one image.
        processor_s: processor time of the whole process while it ran.
    """

    pictures: int = 0
    skipped: int = 0
    blind: Counter[str] = field(default_factory=Counter)
    most_people: int = 0
    processor_s: float = 0.0


class Pipeline:
    """Finds, places and sends the people of each image.

    A scene *sees the room* only if the image shows something, at least one person is in it, and
    all who were found are in the scene. An image without people does not prove an empty room: one
    camera cannot see behind objects, and the network may miss a person.

    Args:
        newest: the input.
        finder: the network.
        placer: places the people.
        sender: sends scenes to the node; None: nothing is sent.
        max_hz: maximum rate of scenes; None: as fast as the network runs.
        stands: a camera whose place in the room is relied on, so it must not be moved; None: it may
            be moved.

    Attributes:
        counts: see ``Counts``.
        last: the last image that was processed, and the people in it.
    """

    def __init__(
        self, newest: Newest, finder: Finder, placer: Placer, *, sender: Sender | None,
        max_hz: float | None = None, stands: Camera | None = None,
    ) -> None:  # fmt: skip
        self._newest, self._finder, self._placer, self._sender = newest, finder, placer, sender
        self._period_ns = 0 if max_hz is None else round(1e9 / max_hz)
        self._due_ns = 0
        self._tracker = Tracker()
        self._frozen = FrozenWatch()
        self._moved = None if stands is None else MovedWatch(stands)
        self._times = SceneTimes()
        self._dropped = 0
        self._said: str | None = None
        self.counts = Counts()
        self.last: tuple[Image, list[Seen]] | None = None

    def run(self, seconds: float | None = None, once: bool = False) -> None:
        """Run until the input ends, for some seconds, or for one image."""
        began_s = time.process_time()
        try:
            self._run(None if seconds is None else time.monotonic() + seconds, once)
        finally:
            self.counts.processor_s += time.process_time() - began_s

    def _run(self, end: float | None, once: bool) -> None:
        heard, silent_s = time.monotonic(), SILENT_S
        while end is None or time.monotonic() < end:
            image = self._newest.take(BLIND_PERIOD_S)
            now = time.monotonic()
            if image is not None:
                silent_s = min(max(SILENT_S, INTERVALS * (now - heard)), MAX_SILENT_S)
                heard = now
                self.take(image)
                if once:
                    return
            elif self._newest.ended:
                return
            elif now - heard > silent_s or self._newest.trouble is not None:
                self._blind(self._newest.trouble or "no image arrives")

    def close(self) -> None:
        """Close the input."""
        self._newest.close()

    @property
    def trouble(self) -> str | None:
        """The reason why no image arrives now."""
        return self._newest.trouble

    def take(self, image: Image) -> None:
        """Process one image."""
        self.counts.pictures += 1
        if self._period_ns and image.exposed_ns < self._due_ns - self._period_ns // 4:
            self.counts.skipped += 1
            return
        is_late = image.exposed_ns - self._due_ns >= self._period_ns
        self._due_ns = (image.exposed_ns if is_late else self._due_ns) + self._period_ns
        wrong = hides(image.pixels) or self._frozen.judge(image)
        if wrong is not None:
            self.last = image, []
            self._blind(wrong)
            return
        if not self._times.admit(image.exposed_ns):
            return
        finding = self._finder.find(image.pixels)
        seen = self._with_ids(finding, image)
        self.last = image, seen
        places = [each.pixels for each in seen]
        moved = None if self._moved is None else self._moved.judge(image, places)
        if moved is not None:
            self._blind(moved)
            return
        self._say(None)
        self.counts.most_people = max(self.counts.most_people, len(seen))
        placed = tuple(self._placer.place(each, image) for each in seen)
        if not finding.is_whole:
            self.counts.blind["there may be more people than are followed"] += 1
        elif not placed:
            self.counts.blind["no person in the image"] += 1
        self._send(placed, sees_room=finding.is_whole and bool(placed), stamp_ns=image.exposed_ns)
        self._times.looked_at(image.exposed_ns)

    def summary(self) -> dict[str, Any]:
        """Return the counts for the user."""
        counts, sender = self.counts, self._sender
        looked = counts.pictures - counts.skipped - self._times.late
        return {
            "pictures": counts.pictures,
            "dropped": self._newest.dropped,
            "skipped": counts.skipped,
            "late": self._times.late,
            "interruptions": self._newest.interruptions,
            "scenes": sender.scenes if sender is not None else 0,
            "unsent": sender.unsent if sender is not None else 0,
            "clock_steps": sender.clock_steps if sender is not None else 0,
            "without_view": dict(counts.blind),
            "background": {} if self._moved is None else {"camera": self._moved.summary()},
            "ids": self._tracker.given,
            "most_people": counts.most_people,
            "unplaced": dict(self._placer.unplaced),
            "latency_ms": self._times.summary(),
            "processor_ms": 1e3 * counts.processor_s / looked if looked else None,
            "stamps": self._newest.stamps,
        }

    def _with_ids(self, finding: Finding, image: Image) -> list[Seen]:
        ids = self._tracker.assign([f.pixels for f in finding.people], image.exposed_ns)
        return [
            Seen(number, self._finder.layout, found.pixels, found.visibility, found.world)
            for number, found in zip(ids, finding.people, strict=True)
        ]

    def _blind(self, why: str) -> None:
        """Report that the room is not seen, and why."""
        self._say(why)
        self.counts.blind[why] += 1
        self._send((), sees_room=False, stamp_ns=self._times.blind_ns())

    def _send(self, people: tuple[SentPerson, ...], *, sees_room: bool, stamp_ns: int) -> None:
        missed = self._newest.dropped - self._dropped
        self._dropped += missed
        if self._sender is not None:
            self._sender.send(people, sees_room=sees_room, stamp_ns=stamp_ns, missed=missed)

    def _say(self, why: str | None) -> None:
        """Print the reason for a blind view when it changes."""
        if why == self._said:
            return
        self._said = why
        line = "images are good again" if why is None else f"{why}: the room is not seen"
        print(f"camera: {line}", file=sys.stderr, flush=True)
