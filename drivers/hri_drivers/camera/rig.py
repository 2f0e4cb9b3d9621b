"""Combines simultaneous images of several calibrated cameras in one room into a scene."""

import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hri_drivers.camera.faults import FrozenWatch, hides
from hri_drivers.camera.moved import MovedWatch
from hri_drivers.camera.network.found import Finder
from hri_drivers.camera.newest import Newest
from hri_drivers.camera.place.camera import Camera
from hri_drivers.camera.place.placed import Unplaced
from hri_drivers.camera.place.together import APART_NS, Together, View, place_together
from hri_drivers.camera.seen import Image, Seen
from hri_drivers.camera.sending import Sender
from hri_drivers.camera.times import BLIND_PERIOD_S, SceneTimes
from hri_drivers.camera.tracking import MAX_ID, Tracker
from hri_drivers.sources.sent import SentPerson

SILENT_S = 0.2
"""Time without simultaneous images after which scenes report that the room is not seen."""
REMEMBERED = 1000
"""Number of newest tracker ids kept, over all cameras. For 4 cameras that follow 4 people each,
this covers some seconds even if every image brings new ids."""
_WAIT_S = 0.005


@dataclass(slots=True, eq=False)
class Eye:
    """One camera of a rig.

    Attributes:
        name: name of the input.
        newest: its images.
        finder: a network of its own, which follows people from image to image.
        camera: calibrated, with its pose in the room.
    """

    name: str
    newest: Newest
    finder: Finder
    camera: Camera
    tracker: Tracker = field(default_factory=Tracker)
    frozen: FrozenWatch = field(default_factory=FrozenWatch)
    moved: MovedWatch = field(init=False)
    image: Image | None = None

    def __post_init__(self) -> None:
        self.moved = MovedWatch(self.camera)


class CommonIds:
    """Ids of people for all cameras, from the ids that each camera's tracker gave.

    A person keeps an id as long as one camera follows that person.
    """

    def __init__(self) -> None:
        self._of: dict[tuple[int, int], int] = {}
        self._given = 0

    def assign(self, people: Sequence[Together]) -> list[int]:
        """Return an id, 1..65535, for each person; no two people have the same id."""
        found: list[int] = []
        for person in people:
            members = [(v, seen.id) for v, seen in enumerate(person.seen) if seen is not None]
            known = [self._of[m] for m in members if m in self._of and self._of[m] not in found]
            number = known[0] if known else self._new(found)
            found.append(number)
            for member in members:
                self._of.pop(member, None)  # so that it counts as the newest
                self._of[member] = number
        for member in list(self._of)[:-REMEMBERED]:
            del self._of[member]
        return found

    def _new(self, taken: Sequence[int]) -> int:
        in_use = {*taken, *self._of.values()}
        while True:
            self._given += 1
            number = (self._given - 1) % MAX_ID + 1
            if number not in in_use:
                return number


class Rig:
    """Finds, places and sends the people that several cameras see at one moment.

    A scene *sees the room* only if all images show something, at least one person is in them, and
    all who were found could be placed. Images whose times come from different kinds of stamps
    never count as simultaneous.

    Args:
        eyes: two or more cameras; people are sent in the axes of the first one.
        sender: sends scenes to the node; None: nothing is sent.

    Attributes:
        scenes: number of sets of images that were processed.
        unpaired: number of images without a simultaneous image from each other camera.
        blind: number of scenes without a view of the room, by reason.
        unplaced: number of people whose position was not known, by reason.
    """

    def __init__(self, eyes: Sequence[Eye], *, sender: Sender | None) -> None:
        self._eyes, self._sender = eyes, sender
        self._ids = CommonIds()
        self._said: str | None = None
        self.scenes = self.unpaired = 0
        self.blind: Counter[str] = Counter()
        self.unplaced: Counter[str] = Counter()
        self._times = SceneTimes()

    def run(self, seconds: float | None = None) -> None:
        """Run until an input ends, or for this many seconds."""
        end = None if seconds is None else time.monotonic() + seconds
        heard = time.monotonic()
        while end is None or time.monotonic() < end:
            images = self.together()
            now = time.monotonic()
            if images is not None:
                heard = now
                self.take(images)
            elif any(eye.newest.ended and eye.image is None for eye in self._eyes):
                return
            elif now - heard > SILENT_S:
                heard = now - SILENT_S + BLIND_PERIOD_S
                self._blind(self.trouble)

    def close(self) -> None:
        """Close the inputs."""
        for eye in self._eyes:
            eye.newest.close()

    @property
    def trouble(self) -> str:
        """The reason why no simultaneous images arrive now."""
        wrong = [f"{e.name}: {e.newest.trouble}" for e in self._eyes if e.newest.trouble]
        return "; ".join(wrong) or "no images taken at the same time arrive"

    def together(self) -> list[Image] | None:
        """Return the newest simultaneous images, one from each camera; None if there are none."""
        for eye in self._eyes:
            if eye.image is None:
                eye.image = eye.newest.take(_WAIT_S)
        images = [eye.image for eye in self._eyes if eye.image is not None]
        if len(images) < len(self._eyes):
            return None
        newest_ns = max(image.exposed_ns for image in images)
        late = [e for e in self._eyes if e.image and newest_ns - e.image.exposed_ns > APART_NS]
        for eye in late or self._eyes:
            eye.image = None
        self.unpaired += len(late)
        return None if late else images

    def take(self, images: Sequence[Image]) -> None:
        """Process simultaneous images."""
        self.scenes += 1
        if len({image.stamped for image in images}) > 1:
            kinds = (f"{e.name} {i.stamped}" for e, i in zip(self._eyes, images, strict=True))
            self._blind(
                f"images are stamped differently ({', '.join(kinds)}); use cameras of one kind"
            )
            return
        for eye, image in zip(self._eyes, images, strict=True):
            wrong = hides(image.pixels) or eye.frozen.judge(image)
            if wrong is not None:
                self._blind(f"{eye.name}: {wrong}")
                return
        stamp_ns = min(image.exposed_ns for image in images)
        if not self._times.admit(stamp_ns):
            return
        views, is_whole = [], True
        for eye, image in zip(self._eyes, images, strict=True):
            finding = eye.finder.find(image.pixels)
            is_whole &= finding.is_whole
            ids = eye.tracker.assign([f.pixels for f in finding.people], image.exposed_ns)
            seen = tuple(
                Seen(number, eye.finder.layout, f.pixels, f.visibility, f.world)
                for number, f in zip(ids, finding.people, strict=True)
            )
            if moved := eye.moved.judge(image, [each.pixels for each in seen]):
                self._blind(f"{eye.name}: {moved}")
                return
            height, width = image.pixels.shape[:2]
            views.append(View(eye.camera.of_size(width, height), image.exposed_ns, seen))
        self._say(None)
        people = place_together(views)
        sent = tuple(
            self._sent(number, each)
            for number, each in zip(self._ids.assign(people), people, strict=True)
        )
        why = None if is_whole else "there may be more people than are followed"
        if not people:
            why = "no person in the images"
        elif any(isinstance(each.placed, Unplaced) for each in people):
            why = why or "a person could not be placed"
        if why is not None:
            self.blind[why] += 1
        self._send(sent, sees_room=why is None, stamp_ns=stamp_ns)
        self._times.looked_at(stamp_ns)

    def summary(self) -> dict[str, Any]:
        """Return the counts for the user."""
        return {
            "scenes": self.scenes,
            "unpaired": self.unpaired,
            "dropped": {eye.name: eye.newest.dropped for eye in self._eyes},
            "late": self._times.late,
            "unsent": self._sender.unsent if self._sender is not None else 0,
            "clock_steps": self._sender.clock_steps if self._sender is not None else 0,
            "without_view": dict(self.blind),
            "background": {eye.name: eye.moved.summary() for eye in self._eyes},
            "unplaced": dict(self.unplaced),
            "latency_ms": self._times.summary(),
            "stamps": {eye.name: eye.newest.stamps for eye in self._eyes},
        }

    def _sent(self, number: int, person: Together) -> SentPerson:
        """Return a person for the node, without observed joints if the position is not known."""
        placed = person.placed
        if isinstance(placed, Unplaced):
            self.unplaced[placed.why] += 1
            joints = next(len(seen.pixels) for seen in person.seen if seen is not None)
            return SentPerson(number, np.full((joints, 3), np.nan), np.zeros(joints, np.bool_))
        return SentPerson(number, placed.positions, placed.observed, placed.error_m)

    def _blind(self, why: str) -> None:
        self._say(why)
        self.blind[why] += 1
        self._send((), sees_room=False, stamp_ns=self._times.blind_ns())

    def _send(self, people: tuple[SentPerson, ...], *, sees_room: bool, stamp_ns: int) -> None:
        if self._sender is not None:
            self._sender.send(people, sees_room=sees_room, stamp_ns=stamp_ns)

    def _say(self, why: str | None) -> None:
        """Print the reason for a blind view when it changes."""
        if why != self._said:
            line = "images are good again" if why is None else f"{why}: the room is not seen"
            print(f"cameras: {line}", file=sys.stderr, flush=True)
        self._said = why
