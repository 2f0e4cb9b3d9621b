"""A scene in its sender's units, axes and frame, before conversion to metres in the room."""

from dataclasses import dataclass

from hri_predict.base.arrays import Bools, Floats
from hri_predict.contracts.scene import Person, Scene


@dataclass(frozen=True, slots=True, eq=False)
class SentPerson:
    """One person as reported by the sender.

    Attributes:
        id: the sender's number for this body, 0..65535.
        positions: (J_source, 3) in the units and axes of the source's joint map, in the sender's
            own frame; NaN where not observed.
        observed: (J_source,) which joints were observed.
        error_m: see ``hri_predict.contracts.scene.Person``; metres, whatever the map's unit is.
    """

    id: int
    positions: Floats
    observed: Bools
    error_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SentScene:
    """One capture as the sender sent it.

    Attributes:
        stamp_ns: time stamp of the capture, nanoseconds of the sender's clock.
        sequence: the sender's counter.
        sees_room: whether the sender saw the room; see ``hri_predict.contracts.scene.Scene``.
        people: every person seen.
        session: changes when the sender and its counter restart.
    """

    stamp_ns: int
    sequence: int
    sees_room: bool
    people: tuple[SentPerson, ...]
    session: int = 0

    def in_room(self, room_from_sent: Floats) -> Scene:
        """Return the scene in metres in the room.

        Args:
            room_from_sent: (4, 4) from the sender's units, axes and frame to metres in the room.
        """
        rotation, origin = room_from_sent[:3, :3], room_from_sent[:3, 3]
        people = tuple(
            Person(p.id, p.positions @ rotation.T + origin, p.observed, error_m=p.error_m)
            for p in self.people
        )
        return Scene(self.stamp_ns, self.sequence, self.sees_room, people)
