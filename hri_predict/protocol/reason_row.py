"""A row of the table of reasons (``protocol.reasons``)."""

from dataclasses import KW_ONLY, dataclass
from enum import Enum, auto
from typing import Literal


class Kind(Enum):
    """The subject of a reason."""

    NONE = auto()
    PEOPLE = auto()
    """Positions and motion of people."""
    WAITING = auto()
    """Only an earlier reason that has not cleared yet."""
    INPUT = auto()
    """The source's scenes; they do not prove that a place is empty (``People``)."""
    MEMORY = auto()
    """People who may be present unseen because the node does not know who was lost."""
    ROBOT = auto()
    PREDICTOR = auto()
    """No forecast was available in time."""
    FORECAST = auto()
    """Forecasts that were wrong, or do not reach far enough."""
    NODE = auto()
    RUN = auto()
    """The start or the end of a run."""
    MODE = auto()
    """An operating mode requested by a controller."""


@dataclass(frozen=True, slots=True)
class Row:
    """Properties of one reason.

    Attributes:
        number: its number on the wire.
        kind: its subject.
        text: what is wrong, for a person.
        clears_when: what clears it, for a person; "" for NONE.
        rank: order, mildest first, among reasons that change continuously into each other; noise
            must not make them alternate (``risk.levels.steady_reason``). ``None``: set and replaced
            without delay.
        latches: latch cause of this reason: "blind" if the room is not seen, "lost" if a person may
            be in it unseen; "" for none.
        short: its text after a body part and a distance, in lists of decisions; "": ``text``.
        by_distance: whether the level depends on the distance of a person.
        in_view: whether people or zones in view stop the robot; recovery may then back it out.
        contradicts: whether RobotStates contradict themselves or each other; the node's Status also
            shows this reason.
        widens_zones: whether it enlarges zones, which makes people appear nearer.
        is_trouble: whether the node is DEGRADED while Status shows it. Widened zones are normal
            work of the self-check, and modes are requested; only muting means trouble.
        is_news: whether it raises an alert even if no level changes.
    """

    number: int
    kind: Kind
    text: str
    clears_when: str
    _: KW_ONLY
    rank: int | None = None
    latches: Literal["", "blind", "lost"] = ""
    short: str = ""
    by_distance: bool = False
    in_view: bool = False
    contradicts: bool = False
    widens_zones: bool = False
    is_trouble: bool = True
    is_news: bool = False
