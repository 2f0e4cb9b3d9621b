"""What ``hri-predict bench links`` measures: delays by kind of link, and how full a wire gets."""

from collections.abc import Iterator
from typing import Any

from hri_predict.errors import LinkError
from hri_sim.link_capacity import saturate
from hri_sim.link_latency import KINDS, latency

BAUDRATES = (115_200, 921_600)
RATES_HZ = (25.0, 100.0)


def kinds() -> list[str]:
    """Kinds of link whose delays can be measured."""
    return list(KINDS)


def delays(names: list[str], seconds: float) -> Iterator[dict[str, Any]]:
    """For each of these kinds and rates what ``latency`` gives, or why there is no such wire."""
    for name in names:
        for rate_hz in RATES_HZ:
            try:
                yield latency(name, rate_hz, seconds)
            except LinkError as error:
                yield {"link": name, "rate_hz": rate_hz, "not_here": str(error)}


def capacities(seconds: float) -> Iterator[dict[str, Any]]:
    """What ``saturate`` gives for each baud rate, with all of the wire and with the default."""
    for baudrate in BAUDRATES:
        for reserved_load in (0.0, 0.3):
            yield saturate(baudrate, seconds, reserved_load)
