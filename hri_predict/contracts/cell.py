"""Contracts of simulated cells and injected faults, both provided by ``hri_sim``.

A *cell* is the equipment at the other ends of simulated links; *faults* are injected into a source
or a link. The node depends only on these contracts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.clock import Clock
from hri_predict.base.settings import Settings
from hri_predict.contracts.link import LinkSettings, Transport
from hri_predict.contracts.source import Source
from hri_predict.robots.model import RobotModel, RobotSettings

Bodies = Mapping[int, tuple[Floats, Bools]]
"""Person's id -> (J, 3) canonical joints in the room, and (J,) whether each is known."""
Joints = Mapping[str, tuple[Floats, Floats]]
"""Robot's name -> (N,) joint positions and velocities, rad and rad/s."""


# -- cells


@dataclass(slots=True, kw_only=True)
class ControllerReport:
    """Events that a controller experienced. Times are in seconds of its own clock.

    Attributes:
        name, role, robot: the link's name, the controller's role, the robot's name.
        ended: outcome: ``ok``, or ``killed`` (then nothing below was reported).
        messages, bytes: good messages received, each frame of a Zone or Pose as one; all bytes
            received.
        crc_errors, counter_errors, malformed, incomplete: counters of the receiver.
        schema_mismatches: Schema messages of another version or hash.
        schema_trouble: the last such Schema received, and the expected one.
        timeouts: number of times the node fell silent.
        stale: number of times the newest advice was, or became, too old.
        max_age_s: maximum age of an advice at receipt, as stated in the message.
        max_gap_s: maximum time between two good Advice messages.
        round_trip_p50_s, round_trip_max_s: from sending a RobotState to an advice that echoes it.
        round_trips: the newest of them as (echoed counter, seconds), if the controller was
            configured to keep them.
        slowdowns: number of changes from full speed to a lower limit.
        stops: number of required stops while motion was permitted.
        states_sent, acknowledges_sent, write_errors: messages sent, and failed writes.
        stop_causes: cause -> number of stops.
        events: [seconds, cause, limit] of each change between running, slow and stopped (at most
            1000), seconds since its start, the limit in m/s.
    """

    name: str
    role: str
    robot: str
    ended: str = "ok"
    messages: int = 0
    bytes: int = 0
    crc_errors: int = 0
    counter_errors: int = 0
    malformed: int = 0
    incomplete: int = 0
    schema_mismatches: int = 0
    schema_trouble: str = ""
    timeouts: int = 0
    stale: int = 0
    max_age_s: float = 0.0
    max_gap_s: float = 0.0
    round_trip_p50_s: float | None = None
    round_trip_max_s: float | None = None
    round_trips: list[tuple[int, float]] = field(default_factory=list)
    slowdowns: int = 0
    stops: int = 0
    states_sent: int = 0
    acknowledges_sent: int = 0
    write_errors: int = 0
    stop_causes: dict[str, int] = field(default_factory=dict)
    events: list[tuple[float, str, float]] = field(default_factory=list)


class TruePeople(Protocol):
    """True positions of all people, from a copy of the source without faults."""

    def open(self, start_ns: int) -> None:
        """Start, at the same time as the node's own copy."""

    def at(self, now_ns: int) -> Bodies:
        """Return the true positions of all people at ``now_ns``."""


class Referee(Protocol):
    """Compares true people with true robots; the node has no access to these data.

    Attributes:
        contacts, contacts_standing: touches of a moving robot, and of a standing robot.
        min_separation_m: minimum distance; ``None`` before any person was observed.
    """

    @property
    def contacts(self) -> int: ...  # noqa: D102

    @property
    def contacts_standing(self) -> int: ...  # noqa: D102

    @property
    def min_separation_m(self) -> float | None: ...  # noqa: D102

    def observe(self, now_ns: int, people: Bodies, robots: Joints, /) -> None:
        """Check the interval since the last observation."""


class Cell(Protocol):
    """Controllers, robots and wires at the other ends of all simulated links.

    Real time: ``start`` ... ``stop``. Virtual clock: ``transports``, then ``step`` at each
    ``next_ns``, then ``stop``.
    """

    def start(self) -> Mapping[str, str]:
        """Start in real time; returns link name -> the device for the node to open.

        Raises:
            LinkError: a controller did not start; the message has the reason.
        """

    def transports(self) -> Mapping[str, Transport[Any]]:
        """Build everything for the virtual clock; return link name -> the node's end of its
        wire.
        """

    def next_ns(self) -> int | None:
        """Return the time of the next step; ``None``: never."""

    def step(self, now_ns: int) -> None:
        """Perform all steps that are due."""

    def robot_truth(self, now_ns: int) -> Joints:
        """Return the true position of every simulated robot."""

    def referee(self, robots: Sequence[RobotModel], /) -> Referee:
        """Return a referee for these robots; pass it the values of ``robot_truth``."""

    def true_people(self, source: Source, /) -> TruePeople:
        """Return the true positions of all people in ``source``, which only this may poll."""

    def stop(self) -> Sequence[ControllerReport]:
        """Stop all controllers; return their reports, link by link. Safe to call twice."""


class CellClass(Protocol):
    """A kind of cell: entry point group ``hri_predict.cells``.

    Attributes:
        settings_model: settings model of a link's ``simulate:`` block.
    """

    @property
    def settings_model(self) -> type[Settings]: ...  # noqa: D102

    def __call__(
        self,
        *,
        links: Sequence[LinkSettings],
        robots: Sequence[RobotSettings],
        base_dir: Path | None,
        clock: Clock,
        factor: float = 1.0,
    ) -> Cell:
        """Check everything; nothing is started yet.

        Args:
            links: the links that have a ``simulate:`` block.
            robots: all configured robots.
            base_dir: the configuration's folder, base of relative paths.
            clock: the node's clock.
            factor: node seconds per wall second.

        Raises:
            ConfigError, RobotError: a ``simulate:`` block or a file is wrong.
        """


# -- faults


class SourceFaults(Protocol):
    """Puts faults between a source and the node: entry point ``source``.

    Attributes:
        kinds: the settings of each kind of fault.
    """

    @property
    def kinds(self) -> Mapping[str, type[Settings]]: ...  # noqa: D102

    def __call__(self, inner: Source, faults: Sequence[dict[str, Any]], /, seed: int) -> Source:
        """Return ``inner`` with the ``faults`` of the configuration.

        Raises:
            ConfigError: a fault of unknown kind or with a wrong key.
        """


class LinkFaults(Protocol):
    """Puts faults between a link and its wire: entry point ``link``.

    Faults that damage units know the units of the shipped links: bytes, CAN frames, keyed payloads.

    Attributes:
        kinds: the settings of each kind of fault.
    """

    @property
    def kinds(self) -> Mapping[str, type[Settings]]: ...  # noqa: D102

    def __call__(
        self, *, inner: Transport[Any], faults: Sequence[dict[str, Any]], clock: Clock, seed: int
    ) -> Transport[Any]:
        """Return ``inner`` with the ``faults`` of the configuration.

        Raises:
            ConfigError: a fault of unknown kind or with a wrong key.
        """


class FaultParser(Protocol):
    """Reads a fault from the command line: entry point ``parse``."""

    def __call__(self, text: str, /) -> dict[str, Any]:
        """``kind[@start[+duration]][:parameter=value,...]`` as in a configuration.

        Raises:
            ConfigError: wrong form, unknown kind or parameter.
        """
