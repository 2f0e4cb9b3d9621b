"""The contract of a source of scenes.

A kind of source is a class: ``SourceClass`` is the interface of the class, ``Source`` that of an
object, and ``Live`` has the additional members of a source that listens to a sender. ``hri-predict
conformance source:NAME`` checks the contract on any kind.
"""

import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self, TypeVar, runtime_checkable

from pydantic import Field, model_validator

from hri_predict.base.arrays import Floats
from hri_predict.base.clock import Clock
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import Pose, Region, Settings, Vector3
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import Scene

ARRIVAL_JITTER_S = 0.01
"""Time by which a capture may come later than its period and the minimum latency."""


class SourceSettings(Settings):
    """Settings common to all sources (``source:`` in the configuration)."""

    kind: str = Field(description="kind of source")
    room_from_source: Pose = Field(description="pose of the source's frame in the room; required")
    min_latency_s: float = Field(
        0.0,
        ge=0,
        le=2,
        description="minimum delay from capture to arrival, which the node cannot measure",
    )
    clock_wander_s: float = Field(
        0.1,
        ge=0,
        le=1,
        description="maximum believed rise of the source's clock offset beyond its steady drift; "
        "an attacker who delays scenes more and more, over hours, can make ages too "
        "small by this much",
    )
    even_captures: bool = Field(
        True,
        description="captures come at an even rate: stamps that scatter about it count as late, by "
        "up to 40 ms; false where captures arrive unevenly and their stamps are right",
    )
    stale_s: float | None = Field(
        None,
        ge=0.01,
        le=2,
        description="age at which input is stale; default: min_latency_s + 2 periods + 10 ms, so"
        " that one lost capture does not count, at most 3 periods + 20 ms",
    )
    field_of_view: Region | None = Field(
        None, description="space that the sensor sees (room frame); the rest counts as occupied"
    )
    keeps_ids: bool = Field(
        False,
        description="an id that comes back is the same person (suits, markers, re-identification); "
        "false where ids may be given to another person",
    )
    sees_free_space: bool = Field(
        False,
        description="where no body is reported in its field of view, the sensor has seen that no "
        "person is there (depth camera, lidar)",
    )
    shadows: list[Region] = Field(
        [], description="space hidden within its field of view: behind machines, pallets"
    )
    viewpoints: list[Vector3] = Field(
        [],
        description="positions of its cameras (room frame), from which people may hide each other",
    )
    faults: list[dict[str, Any]] = Field(
        [], description="faults to inject; see hri_sim.faults.injector"
    )

    safety: ClassVar[Safety] = harmless("min_latency_s") | {
        "clock_wander_s": LessSafe(
            above="a person may be up to {value:g} s older than believed: 1.6 m/s times {more:.2g} "
            "s farther on than with the default"
        ),
        "even_captures": LessSafe(other="stamps are believed, up to 40 ms more than by default"),
        "stale_s": LessSafe(
            above="input {value:.2g} s old is used, not {default:.2g} s; a person walks "
            "1.6 m/s times {more:.2g} s meanwhile"
        ),
        "keeps_ids": LessSafe(other="an id that comes back ends the lost person who had it"),
        "sees_free_space": LessSafe(
            other="a lost person is forgotten where the source reports no body in its view"
        ),
    }

    @model_validator(mode="after")
    def _sees_a_field(self) -> Self:
        if self.sees_free_space and self.field_of_view is None:
            raise ValueError("sees_free_space needs field_of_view: say where it sees")
        if (self.shadows or self.viewpoints) and not self.sees_free_space:
            raise ValueError("shadows and viewpoints have no effect without sees_free_space: true")
        return self

    def stale_after_s(self, rate_hz: float) -> float:
        """Age in seconds at which input of ``rate_hz`` scenes per second is stale."""
        return self.stale_s or self.default_stale_s(rate_hz)

    def default_stale_s(self, rate_hz: float) -> float:
        """``stale_after_s`` unless it is set.

        After a lost capture the previous one stays in use for two periods plus its latency.
        """
        return min(self.min_latency_s + 2.0 / rate_hz + ARRIVAL_JITTER_S, 3.0 / rate_hz + 0.02)

    @property
    def stamps_are_ours(self) -> bool:
        """Whether scenes are stamped by the node's own clock, so that none has to be aligned."""
        return False

    @property
    def judges_bodies(self) -> bool:
        """Whether the source itself judges if bodies move as people do, on one floor.

        Its scenes then carry the doubts.
        """
        return False

    @property
    def known_places(self) -> list[list[float]]:
        """Places [x, y, z] in the room that the source is at, or sees for certain, metres."""
        return [self.room_from_source.xyz, *self.viewpoints]

    @property
    def notes(self) -> list[str]:
        """Notes on this source for the user who checks the configuration, one line each."""
        return []


NOT_KNOWN_NS = 2**62
"""``next_ns`` of a live source that has nothing now: ``arrived`` says when it has."""


@dataclass(slots=True, kw_only=True)
class SourceCounters:
    """Counts of what a live source heard since start; nothing is lost silently.

    A packet is what the sender's numbers count: a datagram, a line, a serial frame.
    """

    packets: int = 0
    bytes_received: int = 0
    scenes: int = 0  # decoded, whether or not they were taken in time
    crc_errors: int = 0
    malformed: int = 0  # wrong length, version, joints or values, whatever its CRC
    unauthenticated: int = 0  # no tag, or not one made with our key
    replayed: int = 0  # heard before, from a session that is over, or stamped too long ago
    lost: int = 0  # numbers that never came
    out_of_order: int = 0  # came after a later one, and was not used
    incomplete: int = 0  # a scene in several parts of which some never came
    ignored: int = 0  # sound, but of a kind that does not say where people are
    unknown_joints: int = 0  # of names that the joint map does not have
    unsure_joints: int = 0  # of less confidence than is configured
    overrun: int = 0  # more scenes than twice the configured rate; the oldest go first
    restarts: int = 0  # the sender began anew
    refused: int = 0  # connections, while others that were heard took all places
    disconnects: int = 0
    reconnects: int = 0
    last_error: str | None = None  # one line about the newest trouble

    def note(self, trouble: Exception | str) -> None:
        """Keep one line about a trouble."""
        lines = str(trouble).splitlines()
        self.last_error = lines[0] if lines else type(trouble).__name__


class Live(Protocol):
    """Additional members of a source that listens to a sender.

    Attributes:
        arrived: set when a scene has come; code that waits for scenes clears it before polling.
            A source that merges several gives all of them one, before they are opened.
        counters: see ``SourceCounters``.
        connected: whether it can hear now (a datagram socket always can).
        stamps_utc: whether senders stamp in UTC, so that their clocks can be compared with ours.
        label: its name in the log and in errors. A source that merges several sets their sensors'.
    """

    arrived: threading.Event
    counters: SourceCounters
    connected: bool
    stamps_utc: bool
    label: str


@runtime_checkable
class HasLive(Protocol):
    """A source that hears a sender, or may do so.

    Attributes:
        live: often the source itself; ``None`` where it has no sender after all.
    """

    @property
    def live(self) -> Live | None: ...  # noqa: D102


@runtime_checkable
class StatesFrame(Protocol):
    """A source whose scenes state their own units and axes; those of the joint map do nothing.

    Attributes:
        stated: (3, 3) from the newest scene's units and axes to metres, forward, left and up;
            ``None`` before the first.
    """

    @property
    def stated(self) -> Floats | None: ...  # noqa: D102


def live_part(source: object) -> Live | None:
    """``source.live`` where the source hears a sender; ``None`` for all others."""
    return source.live if isinstance(source, HasLive) else None


def wait_for(
    source: "Source", due_ns: int, clock: Clock, wake: threading.Event | None = None
) -> None:
    """Return at ``due_ns``, or sooner: when a live source has heard something, or at ``wake``.

    ``wake`` is not looked at where the source is live.
    """
    live = live_part(source)
    if live is None:
        clock.wait_until(due_ns, wake)
    else:
        clock.wait_until(due_ns, live.arrived)
        live.arrived.clear()


class Source(Protocol):
    """Yields scenes as they arrive. A recording, a simulator, a live sender: it is unknown which.

    A source never blocks: the node asks ``poll`` when ``next_ns`` says that it is worth asking.
    That one shape serves real time (a thread sleeps until ``next_ns``) and the virtual clock. A
    source that cannot foresee its scenes has an attribute ``live`` (see ``HasLive``): the thread
    then sleeps until ``next_ns`` or until ``live.arrived`` is set.

    A scene's positions are metres in the room (``room_from_source`` is applied), NaN exactly where
    a joint was not observed. Its sequence rises; its stamp does not go back while the sender lives.

    Attributes:
        joint_map: names of the source's joints and how they become canonical ones.
        rate_hz: nominal scenes per second.
        declares_noise: ``True`` where two captures never have bit-identical joints, so that
            identical ones mean a frozen sensor.
    """

    joint_map: JointMap
    rate_hz: float
    declares_noise: bool

    def open(self, start_ns: int) -> None:
        """Start; the first scene is captured at ``start_ns`` of the node's clock or later.

        Raises:
            HriPredictError: it cannot start; the message says what to do.
        """

    def next_ns(self) -> int | None:
        """When ``poll`` may next have a scene (node's clock); ``None`` when there will be none.

        ``NOT_KNOWN_NS`` where only ``live.arrived`` can say.
        """

    def poll(self, now_ns: int) -> Scene | None:
        """Return the oldest scene that has arrived by ``now_ns`` and was not returned, if any."""

    def close(self) -> None:
        """Release what it holds. Safe to call twice, and before ``open``."""


@runtime_checkable
class HasTwin(Protocol):
    """A source of which a second one costs nothing: nothing is read again."""

    def twin(self) -> Source:
        """Return a source that yields the same scenes from the start, once it is opened."""


S = TypeVar("S", bound=SourceSettings)


class SourceClass(Protocol[S]):
    """Interface that the node requires of a kind of source: a class whose objects are
    ``Source``.
    """

    @property
    def settings_model(self) -> type[S]:
        """The model that validates ``source:`` of this kind."""

    def __call__(self, settings: S, base_dir: Path | None = None, /) -> Source:
        """Make a source; no device is opened yet.

        Args:
            settings: validated by ``settings_model``.
            base_dir: the configuration's folder, where relative paths start.

        Raises:
            HriPredictError: a setting cannot be used; one line with the remedy.
        """


AnySourceClass = SourceClass[SourceSettings]
"""A kind of source by its name alone, as the registry gives it."""
