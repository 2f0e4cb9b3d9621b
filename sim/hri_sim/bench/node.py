"""The measurements of the whole node for ``hri-predict bench``: entry point ``node``, a module."""

import itertools
from collections.abc import Iterator
from typing import Any, get_args

from hri_predict.base.errors import LinkError
from hri_predict.run.config import NodeSettings
from hri_sim.bench.cell import config
from hri_sim.bench.heard import WIRES, heard
from hri_sim.bench.latency import Load, latency

AGE_WIRES = ("serial pty 921600", "CAN FD udp_multicast")

__all__ = ["AGE_WIRES", "WIRES", "ages", "config", "heard", "tick_modes"]


def tick_modes() -> tuple[str, ...]:
    """The ways in which a node can begin its ticks (``ticks:`` of its configuration)."""
    field = NodeSettings.model_fields.get("ticks")
    return ("fixed",) if field is None else get_args(field.annotation)


def ages(
    *,
    wires: tuple[str, ...],
    rates_hz: tuple[float, ...],
    predictors: tuple[str, ...],
    seconds: float,
) -> Iterator[dict[str, Any]]:
    """Yield the result of ``latency`` for each case, or why this machine has no such wire."""
    for wire, rate_hz, predictor, ticks in itertools.product(
        wires, rates_hz, predictors, tick_modes()
    ):
        case = {"link": wire, "rate_hz": rate_hz, "predictor": predictor}
        load = Load(predictor=predictor, ticks=ticks)  # type: ignore[arg-type]
        try:
            found = latency(wire, rate_hz, seconds, load)
        except LinkError as error:
            found = {"not_here": str(error)}
        yield found | case | {"ticks": ticks}
