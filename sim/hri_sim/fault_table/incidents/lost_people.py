"""People who are lost while they are in the room, or mistaken for others."""

from typing import Any

from hri_predict.base.skeleton import JOINTS
from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import ALL_MODES, Incident
from hri_sim.fault_table.people import (
    Person,
    leave,
    person,
    reach,
    reaches_out,
    wait,
    walk,
    walks_out,
)

# -- the tracker loses people while they are in the room -------------------------------------------

_DOOR = [[3.2, 2.0], [4.2, 2.0], [4.2, 3.0], [3.2, 3.0]]
_FLOOR = [[-4, -4], [6, -4], [6, 5], [-4, 5]]
_PALLET = {"polygon": [[1.4, -0.6], [2.2, -0.6], [2.2, 0.8], [1.4, 0.8]], "z_max": 1.3}


def _stands(place: list[float], number: int, enter_s: float, seconds: float) -> dict[str, Any]:
    """Return a person who appears at a place, stands there, and disappears."""
    return person(place, wait(seconds), leave(), id=number, enter_s=enter_s)


def _lost(name: str, *people: Person, ends_s: float = 28.0, **story: Any) -> Incident:
    """Return a story in which the first person, though still there, is lost from 5 s to the end."""
    usual: dict[str, Any] = {
        "faults": (f"vanish@5+{ends_s - 5:g}:person=1",),
        "not_clear": (5.0, ends_s),
        "says": (Reason.PERSON_LOST,),
    }
    return Incident(name=f"lost: {name}", people=people, duration_s=ends_s, **usual | story)


def _id_moves(name: str, at_s: float, *faults: str) -> Incident:
    """Return a story: a person hides at ``at_s``; a colleague who soon walks out gets the id."""
    return Incident(
        name=f"lost: {name}",
        people=(reaches_out(12.0), walks_out(at_s + 2.0, [2.9, 1.7])),
        duration_s=28.0,
        faults=(
            *faults,
            f"vanish@0+{at_s}:person=2",
            f"vanish@{at_s}+23:person=1",
            f"rename@{at_s}+23:person=2,to=1",
        ),
        settings={"source": {"keeps_ids": False}},
        not_clear=(at_s, 28.0),
        says=(Reason.PERSON_LOST,),
    )


_BELOW_SHOULDERS = ",".join(
    name for name in JOINTS if "head" not in name and "shoulder" not in name and name != "neck"
)

_FAR = _stands([4.0, -2.5], 2, enter_s=0.0, seconds=60.0)
"""A person who stays in view, so that scenes continue."""


def _untracked(name: str, faults: tuple[str, ...], says: Reason, **settings: Any) -> Incident:
    """Return a story in which an untracked person vanishes after 5 s and later reaches out."""
    return Incident(
        name=f"lost: {name}",
        people=(_FAR, reaches_out(12.0)),
        duration_s=28.0,
        faults=("vanish@5+23:person=1", *faults),
        settings=settings,
        not_moving=(1.0, 28.0),
        says=(says, Reason.ROOM_NOT_SEEN_EMPTY),
    )


_RUNNER = person([9.0, 0.1], walk([1.0, 0.1], speed_m_s=5.0), wait(10.0))

_STARTS_TO_RUN = person(
    [5.5, 0.1],
    wait(2.0),
    walk([1.0, 0.1], speed_m_s=4.4),
    reach([0.6, 0.1, 0.64], hold_s=8.0, duration_s=0.7),
)
"""A person who is lost 0.4 s into a run, at 1.3 m/s, and reaches 4.4 m/s within a second."""

_GATE = {"polygon": [[-3.7, 2.2], [-3.1, 2.2], [-3.1, 4.2], [-3.7, 4.2]]}

_STAYS_AND_GOES = person([-2.0, 2.5], wait(6.0), walk([-3.95, 3.3]), leave())

_WALKS_BY = person([3.0, -1.8], wait(5.0), walk([2.6, 2.6]), walk([4.5, -2.0]), wait(60.0), id=2)
"""A person who crosses the line of sight before the vehicle."""

_FREE_SPACE = {
    "source": {
        "keeps_ids": False,
        "sees_free_space": True,
        "field_of_view": {"polygon": _FLOOR},
        "viewpoints": [[6.0, 5.0, 3.0]],
    },
    "people": {"exits": [], "room": {"polygon": _FLOOR}},
}

LOST_PEOPLE = (
    _lost("behind a pallet, then reaches out", reaches_out(12.0)),
    _lost(
        "a colleague stands in the door for a second",
        reaches_out(12.0),
        _stands([3.7, 2.5], 2, enter_s=6.0, seconds=1.0),
        says=(),
    ),
    _lost(
        "a colleague gets the lost one's id",
        reaches_out(12.0),
        _stands([3.7, 2.5], 2, enter_s=7.0, seconds=1.0),
        # the only visible person gets another id, and so does the colleague: 1 is lost, comes back
        faults=("vanish@5+23:person=1", "rename@7+2:person=2,to=1"),
        settings={"source": {"keeps_ids": False}},
        says=(),
    ),
    _id_moves("a colleague gets the id while no scene arrives", 6.5, "drop@5+1.5"),
    _id_moves(
        "only head and shoulders seen, then a colleague has the id",
        5.0,
        f"hide@3.5+1.5:person=1,joints=[{_BELOW_SHOULDERS}]",
    ),
    Incident(
        name="lost: a runner, before the robot",
        people=(_RUNNER,),
        duration_s=8.0,
        faults=("vanish@0.9+7",),
        not_clear=(1.1, 8.0),
        not_moving=(1.9, 8.0),
    ),
    Incident(
        name="lost: in the doorway, but not on the way out",
        people=(reaches_out(12.0, enter_s=1.0),),
        duration_s=24.0,
        faults=("vanish@1.1+23:person=1",),
        not_clear=(6.0, 24.0),
    ),
    Incident(
        # nobody vanishes in the open: that place must be seen again before it counts as free
        name="lost: in the open for a while, seen there again, so the cell works on",
        people=(_STAYS_AND_GOES,),
        duration_s=13.0,
        faults=("vanish@3+2:person=1", "rename@5+11:person=1,to=7"),
        settings=_FREE_SPACE | {"people": {"exits": [_GATE], "room": {"polygon": _FLOOR}}},
        moving=(9.5, 13.0),
        says=(Reason.PERSON_LOST,),
        never_says=(Reason.OUT_OF_VIEW,),
    ),
    _lost(
        "behind a vehicle that stops between, where the source sees free space",
        reaches_out(10.0),
        _FAR,
        ends_s=24.0,
        settings=_FREE_SPACE,
    ),
    _lost(
        "behind a vehicle, while a colleague walks by",
        reaches_out(10.0),
        _WALKS_BY,
        ends_s=24.0,
        settings=_FREE_SPACE,
    ),
    Incident(
        name="lost: a runner, while he speeds up",
        people=(_STARTS_TO_RUN,),
        duration_s=7.0,
        faults=("vanish@2.4+7",),
        settings={"people": {"exits": []}},
        not_clear=(2.7, 7.0),
        not_moving=(3.3, 7.0),
    ),
    _lost(
        "behind a pallet, where free space is not seen",
        reaches_out(12.0),
        settings={
            "source": {
                "sees_free_space": True,
                "field_of_view": {"polygon": _FLOOR},
                "shadows": [_PALLET],
                "viewpoints": [[6.0, 5.0, 3.0]],
            },
            "people": {"exits": [{"polygon": _DOOR}], "room": {"polygon": _FLOOR}},
        },
    ),
    _untracked("one too many", (), Reason.TOO_MANY_PEOPLE, people={"max_people": 1}),
    _untracked("under the id of another", ("rename@0+28:person=1,to=2",), Reason.INPUT_IMPOSSIBLE),
    _untracked(
        "never showed a joint",
        (f"hide@0+28:person=1,joints=[{','.join(JOINTS)}]",),
        Reason.PERSON_NOT_LOCATED,
    ),
)


# -- an id moves from a person who is then hidden to a colleague, who walks out --------------------

_HIDES_S = 5.0


def _incident(name: str, place: list[float], *faults: str) -> Incident:
    """Return a story with a worker hidden from ``_HIDES_S`` on and a colleague at ``place``."""
    return Incident(
        name=f"identity: {name}",
        people=(reaches_out(12.0), walks_out(_HIDES_S + 3.0, place)),
        duration_s=28.0,
        faults=faults,
        settings={"source": {"keeps_ids": False}},
        modes=ALL_MODES,
        not_clear=(_HIDES_S, 28.0),
        says=(Reason.PERSON_LOST,),
    )


def _others(*parts: str) -> str:
    """Return the joints of all other body parts, as a list for a fault."""
    return ",".join(name for name in JOINTS if name[2:] not in parts)


_ONE_CAPTURE = "+0.03"
_AFTER = f"@{_HIDES_S}+23"
_BESIDE = [2.1, 0.35]

IDENTITY = (
    _incident(
        "one capture under a colleague's id",
        [2.9, 1.7],
        "vanish@0+4.99:person=1",
        f"vanish@4.99{_ONE_CAPTURE}:person=2",
        f"rename@4.99{_ONE_CAPTURE}:person=1,to=2",
        "vanish@5.02+23:person=1",
    ),
    _incident(
        "slides to a colleague 0.43 m behind",
        _BESIDE,
        f"vanish@0+{_HIDES_S}:person=2",
        f"vanish{_AFTER}:person=1",
        f"rename{_AFTER}:person=2,to=1",
    ),
    _incident(
        "a colleague appears 0.43 m beside, 0.4 s later",
        _BESIDE,
        f"vanish@0+{_HIDES_S + 0.4}:person=2",
        f"vanish{_AFTER}:person=1",
    ),
    _incident(
        "alternates between two people",
        _BESIDE,
        "vanish@0+3.5:person=1",
        "alternate@3.5+1.5:person=2,other=1",
        f"vanish{_AFTER}:person=1",
    ),
    _incident(
        "slides from arms to a colleague's legs",
        [2.3, 0.53],
        f"vanish@0+{_HIDES_S}:person=2",
        f"hide@4+1:person=1,joints=[{_others('elbow', 'wrist', 'hand')}]",
        f"vanish{_AFTER}:person=1",
        f"hide@5+1:person=2,joints=[{_others('knee', 'ankle', 'foot')}]",
        f"rename{_AFTER}:person=2,to=1",
    ),
)


# -- people who vanish in an exit, or at its edge, and have not left by it; and one who has --------

_EXIT = {"polygon": _DOOR}
_ENDS_S = 16.0
_LEGS = ",".join(name for name in JOINTS if name[2:] in ("knee", "ankle", "foot"))


def _and_back(start: list[float], to: list[float], speed_m_s: float = 1.2) -> dict[str, Any]:
    """Return a person who walks away, returns to the robot, and reaches into its path."""
    return person(
        start,
        walk(to, speed_m_s=speed_m_s),
        walk([1.12, 0.1]),
        reach([0.72, 0.1, 0.64], hold_s=6.0),
    )


def _returns(
    name: str, person: dict[str, Any], gone_s: float, *faults: str, **exit_: Any
) -> Incident:
    """Return a story of a person who vanishes at the exit at ``gone_s`` and returns unseen."""
    return Incident(
        name=f"exit: {name}",
        people=(person,),
        duration_s=_ENDS_S,
        faults=(*faults, f"vanish@{gone_s}+{_ENDS_S}:person=1"),
        settings={"source": {"keeps_ids": False}, "people": {"exits": [_EXIT | exit_]}},
        not_clear=(gone_s + 1.5, _ENDS_S),
        says=(Reason.PERSON_LOST,),
    )


EXITS = (
    _returns(
        "lost a third of a metre inside, on the way out", _and_back([1.5, 0.5], [3.8, 2.6]), 2.7
    ),
    _returns("turns round before the side that leads out", _and_back([1.8, 0.6], [4.0, 2.8]), 3.45),
    _returns(
        "passes its edge, and a pallet hides the legs",
        _and_back([3.3, 0.2], [3.3, 2.9]),
        2.75,
        f"hide@1.9+1:person=1,joints=[{_LEGS}]",
    ),
    _returns(
        "passes by the line that leads out",
        _and_back([3.7, 0.2], [3.7, 3.3]),
        3.1,
        out=[[4.2, 2.2], [4.2, 2.8]],
    ),
    Incident(
        name="exit: walks out, so the cell works on",
        people=(person([1.8, 0.6], walk([4.6, 3.2]), leave()),),
        duration_s=9.0,
        settings={"source": {"keeps_ids": False}, "people": {"exits": [_EXIT]}},
        moving=(6.5, 9.0),
        never_says=(Reason.PERSON_LOST,),
    ),
)
