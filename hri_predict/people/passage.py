"""Progress of a body on its way through an exit, kept by each track."""

from dataclasses import dataclass, field

import numpy as np

from hri_predict.base.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """A side of an exit through which people may leave.

    Attributes:
        a, b: (2,) its ends, metres.
        out: (2,) unit vector that leads out of the exit.
        beyond_m: distance behind the side up to which a body has left; farther off it is in the
            room.
        named: whether this side is configured as leading out.
    """

    a: Floats
    b: Floats
    out: Floats
    beyond_m: float
    named: bool

    def crossing(self, begin: Floats, end: Floats, error_m: float = 0.0) -> Floats | None:
        """Return (2,) where the path from ``begin`` to ``end`` crosses this side outwards, if it
        does.

        A path with an error of ``error_m`` must cross the side at least that far from both ends.
        """
        before, after = float((begin - self.a) @ self.out), float((end - self.a) @ self.out)
        if not before <= 0.0 < after:
            return None
        at: Floats = begin + (end - begin) * (before / (before - after))
        edge = self.b - self.a
        within = error_m * float(np.hypot(*edge))
        return at if within <= float((at - self.a) @ edge) <= float(edge @ edge) - within else None


@dataclass(slots=True, eq=False)
class Visit:
    """A body in an exit.

    Attributes:
        door: the exit's index.
        begin: (2,) point of entry.
        from_room: whether the body came from the room.
        fits: whether the exit had room for its whole width at some capture.
    """

    door: int
    begin: Floats
    from_room: bool
    fits: bool = False


@dataclass(slots=True, eq=False)
class Crossed:
    """A body's outward crossing of a side of an exit.

    Attributes:
        side: the side.
        at: (2,) position of the crossing.
        farthest_m: largest distance behind the side since then.
    """

    side: Side
    at: Floats
    farthest_m: float = 0.0

    def out_m(self, place: Floats) -> float:
        """Return how far behind that side ``place`` (2,) is; negative in front of it."""
        return float((place - self.at) @ self.side.out)

    def holds(self, place: Floats) -> bool:
        """Return whether a body at ``place`` (2,) is still behind that side, and near it."""
        return self.out_m(place) > 0 and np.hypot(*(place - self.at)) <= self.side.beyond_m


@dataclass(slots=True, eq=False)
class Passage:
    """Progress of a body's path through exits.

    Attributes:
        place: (2,) where it stood when its hips or feet were last seen.
        seen_ns: time of that capture.
        travelled: (2,) ``Trail.place`` in that capture.
        in_room: whether the body was seen outside of every exit, and has not come in through one
            since.
        visit: the exit in which the body is.
        crossed: the side through which the body has left without returning.
    """

    place: Floats | None = None
    seen_ns: int = 0
    travelled: Floats = field(default_factory=lambda: np.zeros(2))
    in_room: bool = False
    visit: Visit | None = None
    crossed: Crossed | None = None

    @property
    def was_in_room(self) -> bool:
        """Whether the body was seen in the room before it came to where it is."""
        from_room = self.visit is not None and self.visit.from_room
        return self.in_room or from_room or self.crossed is not None
