"""The contract of a source of scenes.

A kind of source is a class: ``SourceClass`` is the interface of the class, ``Source`` that of an
object, and ``Live`` has the additional members of a source that listens to a sender. ``hri-predict
conformance source:NAME`` checks the contract on any kind.
"""

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self, TypeVar, runtime_checkable

from pydantic import Field, model_validator

from hri_predict.base.arrays import Floats
from hri_predict.base.clock import Clock
from hri_predict.base.errors import first_line
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import Pose, Region, Settings, Vector3
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import Scene

ARRIVAL_JITTER_S = 0.01
"""Permitted lateness of a capture beyond its period and the minimum latency."""


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
        description="captures come at an even rate: stamps that deviate from it are treated as "
        "late, by up to 40 ms; false if captures are uneven and their stamps correct",
    )
    stale_s: float | None = Field(
        None,
        ge=0.01,
        le=2,
        description="age at which input is stale; default: min_latency_s + 2 periods + 10 ms, "
        "which tolerates one lost capture; at most 3 periods + 20 ms",
    )
    field_of_view: Region | None = Field(
        None,
        description="space that the sensor observes (room frame); the rest is treated as occupied",
    )
    keeps_ids: bool = Field(
        False,
        description="a returning id is the same person (suits, markers, re-identification); false "
        "if ids may be reused for another person",
    )
    sees_free_space: bool = Field(
        False,
        description="the sensor observes free space: without a reported body in its field of "
        "view, no person is there (depth camera, lidar)",
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
            above="input may be up to {value:g} s older than assumed: a person may be 1.6 m/s "
            "times {more:.2g} s farther along than with the default"
        ),
        "even_captures": LessSafe(other="stamps are trusted by up to 40 ms more than by default"),
        "stale_s": LessSafe(
            above="input {value:.2g} s old is used, not {default:.2g} s; a person walks "
            "1.6 m/s times {more:.2g} s meanwhile"
        ),
        "keeps_ids": LessSafe(other="a returning id removes the lost person with that id"),
        "sees_free_space": LessSafe(
            other="a lost person is removed where the source reports no body in its view"
        ),
    }

    @model_validator(mode="after")
    def _sees_a_field(self) -> Self:
        if self.sees_free_space and self.field_of_view is None:
            raise ValueError("sees_free_space needs field_of_view: define the observed space")
        if (self.shadows or self.viewpoints) and not self.sees_free_space:
            raise ValueError("shadows and viewpoints have no effect without sees_free_space: true")
        return self

    def stale_after_s(self, rate_hz: float) -> float:
        """Age in seconds at which input of ``rate_hz`` scenes per second is stale."""
        return self.stale_s or self.default_stale_s(rate_hz)

    def default_stale_s(self, rate_hz: float) -> float:
        """Default of ``stale_after_s``.

        After a lost capture the previous one remains in use for two periods plus its latency.
        """
        return min(self.min_latency_s + 2.0 / rate_hz + ARRIVAL_JITTER_S, 3.0 / rate_hz + 0.02)

    @property
    def stamps_are_ours(self) -> bool:
        """Whether scenes are stamped by the node's own clock, so that alignment is not needed."""
        return False

    @property
    def judges_bodies(self) -> bool:
        """Whether the source itself checks that bodies move like people, on one floor.

        Its scenes then contain the doubts.
        """
        return False

    @property
    def parts(self) -> Mapping[str, "SourceSettings"]:
        """Settings of the sources that this one combines, by name; by default none."""
        return {}

    @property
    def known_places(self) -> list[list[float]]:
        """Positions [x, y, z] in the room, metres: the source's own, or points it certainly
        observes.
        """
        return [self.room_from_source.xyz, *self.viewpoints]

    @property
    def notes(self) -> list[str]:
        """Notes on this source for the user who checks the configuration, one line each."""
        return []


NOT_KNOWN_NS = 2**62
"""``next_ns`` of a live source without a scene: wait for ``arrived`` instead."""


@dataclass(slots=True, kw_only=True)
class SourceCounters:
    """Counters of a live source since start; nothing is lost silently.

    A packet is the unit numbered by the sender: a datagram, a line, a serial frame.
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
        """Store one line about an error."""
        self.last_error = first_line(trouble)


class Live(Protocol):
    """Additional members of a source that listens to a sender.

    Attributes:
        arrived: set when a scene has arrived; code that waits for scenes clears it before polling.
            A source that merges several gives them a shared event before they are opened.
        counters: see ``SourceCounters``.
        connected: whether it can receive now (a datagram socket always can).
        stamps_utc: whether senders stamp in UTC, so that their clocks can be compared with ours.
        label: its name in the log and in errors. A source that merges several sets the labels of
            its sensors.
    """

    arrived: threading.Event
    counters: SourceCounters
    connected: bool
    stamps_utc: bool
    label: str


@runtime_checkable
class HasLive(Protocol):
    """A source that may receive from a sender.

    Attributes:
        live: often the source itself; ``None`` without a sender.
    """

    @property
    def live(self) -> Live | None: ...  # noqa: D102


@runtime_checkable
class StatesFrame(Protocol):
    """A source with scenes that state their own units and axes; those of the joint map have no
    effect.

    Attributes:
        stated: (3, 3) from the newest scene's units and axes to metres, forward, left and up;
            ``None`` before the first.
    """

    @property
    def stated(self) -> Floats | None: ...  # noqa: D102


def live_part(source: object) -> Live | None:
    """Return ``source.live`` if the source receives from a sender; otherwise ``None``."""
    return source.live if isinstance(source, HasLive) else None


def wait_for(
    source: "Source", due_ns: int, clock: Clock, wake: threading.Event | None = None
) -> None:
    """Return at ``due_ns``, or sooner when a live source has received data, or at ``wake``.

    ``wake`` is ignored for a live source.
    """
    live = live_part(source)
    if live is None:
        clock.wait_until(due_ns, wake)
    else:
        clock.wait_until(due_ns, live.arrived)
        live.arrived.clear()


class Source(Protocol):
    """Yields scenes as they arrive.

    Its origin is hidden: a recording, a simulator or a live sender. A source never blocks: the node
    calls ``poll`` at ``next_ns``. This interface works in real time (a thread sleeps until
    ``next_ns``) and on the virtual clock. A source that cannot predict the arrival of scenes has an
    attribute ``live`` (see ``HasLive``): the thread then sleeps until ``next_ns`` or until
    ``live.arrived`` is set.

    A scene's positions are metres in the room (``room_from_source`` is applied), NaN exactly where
    a joint was not observed. Its sequence increases; its stamp does not go back while the sender
    runs.

    Attributes:
        joint_map: names of the source's joints and their mapping to canonical ones.
        rate_hz: nominal scenes per second.
        declares_noise: ``True`` if two captures never have bit-identical joints, so that identical
            joints mean a frozen sensor.
    """

    joint_map: JointMap
    rate_hz: float
    declares_noise: bool

    def open(self, start_ns: int) -> None:
        """Start; the first scene is captured at ``start_ns`` of the node's clock or later.

        Raises:
            HriPredictError: it cannot start; the message contains the remedy.
        """

    def next_ns(self) -> int | None:
        """Return when ``poll`` may next have a scene (node's clock); ``None`` if there are no more
        scenes.

        ``NOT_KNOWN_NS`` if only ``live.arrived`` can signal it.
        """

    def poll(self, now_ns: int) -> Scene | None:
        """Return the oldest scene that has arrived by ``now_ns`` and was not returned, if any."""

    def close(self) -> None:
        """Release all resources. Safe to call twice, and before ``open``."""


@runtime_checkable
class HasTwin(Protocol):
    """A source that can be copied cheaply, without reading its data again."""

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
        """Create a source without opening a device.

        Args:
            settings: validated by ``settings_model``.
            base_dir: the configuration's folder, base of relative paths.

        Raises:
            HriPredictError: a setting cannot be used; one line with the remedy.
        """


AnySourceClass = SourceClass[SourceSettings]
"""Any kind of source, as returned by the registry."""
