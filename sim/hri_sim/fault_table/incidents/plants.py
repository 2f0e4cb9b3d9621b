"""Restart types and configuration sets, under faults of the PLC that sends presses and choices."""

from collections.abc import Callable
from typing import Any

from hri_predict.contracts.link import Received
from hri_predict.protocol.messages import Acknowledge, Advice, FromController, SetChoice
from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import Incident, Span
from hri_sim.fault_table.people import FAR, leave, person, wait, walk

Says = Callable[[float, int], list[FromController]]
"""Messages that a PLC sends in a cycle, by seconds since the start and the latch id shown now."""


def _plc(*says: Says) -> Callable[[Any], None]:
    """Add one PLC to each link, which delivers its messages as a plant link would."""

    def prepare(assembly: Any) -> None:
        for link, each in zip(assembly.links, says, strict=False):
            _connect(link, each, assembly.clock)

    return prepare


def _connect(link: Any, says: Says, clock: Any) -> None:
    start_ns, shown = clock.now_ns(), [0]
    take, post = link.take, link.post

    def posted(message: Any) -> None:
        if isinstance(message, Advice):
            shown[0] = message.latch_id
        post(message)

    def taken() -> list[Received]:
        now_ns = clock.now_ns()
        said = says((now_ns - start_ns) * 1e-9, shown[0])
        return [*take(), *(Received(message, now_ns) for message in said)]

    link.take, link.post = taken, posted


# -- restart: a person stops the robot, and is out of the room 13 s after the start ----------------

_PASSES = person(
    [3.6, 2.4],
    walk([1.3, 0.1], via=[[2.4, 0.9]]),
    wait(0.5),
    walk([4.5, 3.4], via=[[2.4, 0.9], [3.3, 2.1]]),
    leave(),
)
_STOPPED: Span = (14.0, 18.0)
_DOWN_S, _UP_S = 18.0, 18.5


def _edges(down_s: float, up_s: float, ack_id: int = 7) -> Says:
    """Return a PLC that presses for the shown id and releases, each repeated for 0.1 s."""
    pressed = [0]

    def says(now_s: float, latch_id: int) -> list[FromController]:
        if down_s <= now_s < down_s + 0.1:
            pressed[0] = pressed[0] or latch_id
            return [Acknowledge(pressed[0], ack_id)]
        return [Acknowledge(0, ack_id)] if up_s <= now_s < up_s + 0.1 else []

    return says


def _held(now_s: float, latch_id: int) -> list[FromController]:
    """Press for the shown id, and repeat the press for good."""
    return [Acknowledge(latch_id, 7)] if now_s >= _STOPPED[0] else []


def _restart(name: str, restart: str, says: Says, *, works: bool = False) -> Incident:
    return Incident(
        name=f"restart {restart}: {name}",
        people=(_PASSES,),
        duration_s=23.0,
        settings={"risk": {"restart": restart, "latch": ["stop"]}},
        modes=("predictive",),
        not_moving=_STOPPED if works else (_STOPPED[0], 23.0),
        moving=(19.0, 23.0) if works else None,
        says=(Reason.LATCHED,),
        prepare=_plc(says),
    )


RESTARTS = (
    _restart("the button is pressed and let go", "supervised", _edges(_DOWN_S, _UP_S), works=True),
    _restart("the button is pressed", "manual", _edges(_DOWN_S, 1e9), works=True),
    _restart("the button is held down", "supervised", _held),
    _restart("PLC gone while the button is down", "supervised", _edges(_DOWN_S, 1e9)),
    _restart("a release without a press", "supervised", _edges(1e9, _UP_S)),
    _restart("let go after 0.05 s", "supervised", _edges(_DOWN_S, _DOWN_S + 0.05)),
    _restart("let go after 5 s", "supervised", _edges(_DOWN_S, _DOWN_S + 5.0)),
    _restart("pressed before the stop, with nothing to acknowledge", "manual", _edges(0.5, 1.0)),
    _restart(
        "pressed before the stop, with nothing to acknowledge", "supervised", _edges(0.5, 1.0)
    ),
    _restart("PLC gone", "manual", lambda now_s, latch_id: []),
)


# -- sets: a person stands in a zone that asks for a stop in set 1, and for nothing in set 2 -------

_ROUND_FAR = [[4.0, -0.3], [5.0, -0.3], [5.0, 0.7], [4.0, 0.7]]
_SETS = {
    "zones": [{"name": "hatch", "polygon": _ROUND_FAR, "level": "stop"}],
    "risk": {
        "sets": [{"number": 1, "name": "production"}, {"number": 2, "name": "loading", "zones": []}]
    },
}
_BREAKS_S, _MENDS_S = 4.0, 8.0


def _chosen(during: Callable[[float], int | None]) -> Says:
    """Return a PLC that chooses set 2 at 10 Hz, and ``during(now_s)`` during the fault."""
    due_s = [0.0]

    def says(now_s: float, latch_id: int) -> list[FromController]:
        if now_s < due_s[0]:
            return []
        due_s[0] = now_s + 0.1
        number = during(now_s) if _BREAKS_S <= now_s < _MENDS_S else 2
        return [] if number is None else [SetChoice(number)]

    return says


def _set(name: str, during: Callable[[float], int | None], **more: Any) -> Incident:
    conditions: dict[str, Any] = {
        "moving": (_MENDS_S + 2.0, 12.0),
        "not_moving": (_BREAKS_S + 0.2, _MENDS_S),
        "says": (Reason.SET_UNKNOWN,),
    } | more
    return Incident(
        name=f"set: {name}",
        people=(FAR,),
        duration_s=12.0,
        settings=_SETS,
        modes=("predictive",),
        prepare=conditions.pop("prepare", None) or _plc(_chosen(during)),
        **conditions,
    )


_STILL_2 = _chosen(lambda now_s: 2)
SETS = (
    _set("PLC gone for 4 s", lambda now_s: None, not_moving=(_BREAKS_S + 1.2, _MENDS_S)),
    _set("a number that no set has", lambda now_s: 9),
    _set("number 0", lambda now_s: 0),
    _set(
        "flapping between the strict set and the other",
        lambda now_s: 1 + round(now_s * 10) % 2,
        says=(),
    ),
    _set("flapping to a number that no set has", lambda now_s: 2 if round(now_s * 10) % 2 else 9),
    _set(
        "two PLCs differ",
        lambda now_s: 1,
        prepare=_plc(_chosen(lambda now_s: 1), _STILL_2),
        says=(),
    ),
    _set(
        "never chosen",
        lambda now_s: None,
        prepare=_plc(lambda now_s, latch_id: []),
        moving=None,
        not_moving=(0.0, 12.0),
    ),
)
