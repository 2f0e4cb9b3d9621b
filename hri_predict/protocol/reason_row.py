"""A row of the table of reasons (``protocol.reasons``)."""

from dataclasses import KW_ONLY, dataclass
from enum import Enum, auto
from typing import Literal


class Kind(Enum):
    """The subject of a reason."""

    NONE = auto()
    PEOPLE = auto()
    """Places and motion of people."""
    WAITING = auto()
    """Nothing but that an earlier reason is not over."""
    INPUT = auto()
    """The source's scenes: none of them proves that a place is empty (``People``)."""
    MEMORY = auto()
    """People who may be present unseen, because the node does not know who was lost."""
    ROBOT = auto()
    PREDICTOR = auto()
    """No forecast in time."""
    FORECAST = auto()
    """Forecasts that do not hold, or do not reach far enough."""
    NODE = auto()
    RUN = auto()
    """The start or the end of a run."""
    MODE = auto()
    """An operating mode that a controller asked for."""


@dataclass(frozen=True, slots=True)
class Row:
    """Everything that the node knows about one reason.

    Attributes:
        number: its number on the wire.
        text: what is wrong, for a person.
        clears_when: what clears it, for a person; "" for NONE.
        kind: its subject.
        rank: place among the reasons that pass into each other without a step in between, mildest
            first; noise must not make them alternate (``risk.levels.steady_reason``). ``None``:
            given, and replaced, at once.
        latches: the cause of a latch that it is: "blind" if the room is not seen, "lost" if a
            person may be in it unseen; "" for none.
        by_distance: whether the distance of a person decides the level.
        in_view: whether people or zones in view stop the robot, so that recovery may back it out.
        contradicts: whether RobotStates contradict themselves: the node's status names it, too.
        widens_zones: whether zones are larger because of it, and so people nearer.
        is_trouble: whether the node is DEGRADED while Status names it. Widened zones are the
            self-check at work, and modes are asked for; but muting means trouble.
        is_news: whether it raises an alert even where no level changes.
    """

    number: int
    text: str
    clears_when: str
    kind: Kind
    _: KW_ONLY
    rank: int | None = None
    latches: Literal["", "blind", "lost"] = ""
    by_distance: bool = False
    in_view: bool = False
    contradicts: bool = False
    widens_zones: bool = False
    is_trouble: bool = True
    is_news: bool = False
