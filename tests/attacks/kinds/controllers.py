"""Hands at the simulated controllers: what they send, changed by an attack."""

from collections.abc import Callable
from typing import Any

from hri_predict.base.arrays import Floats
from hri_predict.protocol.messages import Acknowledge, Advice
from hri_predict.run.session import VIRTUAL_START_NS
from hri_sim.controllers.cell import MockCell

Reported = Callable[[float, Floats, Floats], tuple[Floats, Floats]]
"""Seconds, true joints and velocities -> those that RobotState reports."""


def report_instead(cell: MockCell, reported: Reported, links: tuple[str, ...]) -> None:
    """Let the controllers of some links report other joints in RobotState."""
    for core in _cores(cell, links):
        outgoing = core.outgoing

        def lying(now_ns: int, q: Any, qd: Any, *a: Any, _o: Any = outgoing, **k: Any) -> Any:
            if q is not None:
                q, qd = reported((now_ns - VIRTUAL_START_NS) * 1e-9, q, qd)
            return _o(now_ns, q, qd, *a, **k)

        core.outgoing = lying


def acknowledge(
    cell: MockCell, due: Callable[[float, int], Acknowledge | None], links: tuple[str, ...]
) -> None:
    """Let controllers send what ``due`` returns for the time and the latch id shown, 0: none."""
    for core in _cores(cell, links):
        outgoing, take, shown = core.outgoing, core._take_advice, [0]

        def noted(advice: Advice, now_ns: int, _t: Any = take, _s: list[int] = shown) -> None:
            _s[0] = advice.latch_id
            _t(advice, now_ns)

        def pressing(
            now_ns: int, *a: Any, _o: Any = outgoing, _c: Any = core, _s: Any = shown, **k: Any
        ) -> Any:
            units = _o(now_ns, *a, **k)
            message = due((now_ns - VIRTUAL_START_NS) * 1e-9, _s[0])
            return units if message is None else units + _c._codec.encode(message)

        core._take_advice, core.outgoing = noted, pressing


def _cores(cell: MockCell, links: tuple[str, ...]) -> list[Any]:
    return [s.core for s, _ in cell._stations if s.post.name in links]
