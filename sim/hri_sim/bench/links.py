"""The measurements of ``hri-predict bench links``: delays by kind of link, load of a wire."""

from collections.abc import Iterator, Sequence
from typing import Any

from hri_predict.base.errors import LinkError
from hri_sim.bench.capacity import saturate
from hri_sim.bench.latency import KINDS, Load, latency

BAUDRATES = (115_200, 921_600)


def kinds() -> list[str]:
    """Return the kinds of link whose delays can be measured."""
    return list(KINDS)


def delays(
    names: list[str], rates_hz: Sequence[float], seconds: float, /, **load: Any
) -> Iterator[dict[str, Any]]:
    """Yield the result of ``latency`` for each kind and rate, or why this machine has no wire.

    ``load`` as in ``Load``.
    """
    for name in names:
        for rate_hz in rates_hz:
            try:
                yield latency(name, rate_hz, seconds, Load(**load))
            except LinkError as error:
                yield {"link": name, "rate_hz": rate_hz, "not_here": str(error)}


def capacities(seconds: float) -> Iterator[dict[str, Any]]:
    """Yield the result of ``saturate`` for each baud rate, with the whole wire and the default."""
    for baudrate in BAUDRATES:
        for reserved_load in (0.0, 0.3):
            yield saturate(baudrate, seconds, reserved_load)
