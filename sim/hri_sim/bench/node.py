"""The measurements of the whole node for ``hri-predict bench``: entry point ``node``, a module."""

from collections.abc import Iterator
from typing import Any

from hri_predict.errors import LinkError
from hri_sim.bench.cell import MAX_PEOPLE, config, tick_modes
from hri_sim.bench.heard import WIRES, heard
from hri_sim.bench.latency import latency

AGE_WIRES = ("serial pty 921600", "CAN FD udp_multicast")

__all__ = ["AGE_WIRES", "MAX_PEOPLE", "WIRES", "ages", "config", "heard", "tick_modes"]


def ages(
    *,
    wires: tuple[str, ...],
    rates_hz: tuple[float, ...],
    predictors: tuple[str, ...],
    seconds: float,
) -> Iterator[dict[str, Any]]:
    """Yield the result of ``latency`` for each case, or why this machine has no such wire."""
    for wire in wires:
        for rate_hz in rates_hz:
            for predictor in predictors:
                for ticks in tick_modes() or (None,):
                    case = {"link": wire, "rate_hz": rate_hz}
                    case |= {"predictor": predictor, "ticks": ticks or "fixed rate"}
                    try:
                        yield case | latency(
                            wire, rate_hz, seconds, predictor=predictor, ticks=ticks
                        )
                    except LinkError as error:
                        yield case | {"not_here": str(error)}
