"""Runs of a node that several sections look at: each is made once in a bench."""

from functools import lru_cache
from typing import Any

from hri_predict.base.errors import LinkError

RATE_HZ = 25.0


@lru_cache(maxsize=32)
def heard(
    wire: str, predictor: str, seconds: float, *, watched: bool = False
) -> dict[str, Any] | str:
    """See ``NodeBench.heard``; one line if this machine has no such wire."""
    from hri_sim.bench import node as bench

    try:
        return bench.heard(
            wire=wire, predictor=predictor, rate_hz=RATE_HZ, seconds=seconds, watched=watched
        )
    except LinkError as error:
        return str(error)


def wires() -> tuple[str, ...]:
    """The wires that can be heard, the plainest first."""
    from hri_sim.bench import node

    return tuple(node.WIRES)


def short(wire: str) -> str:
    """A wire's name in a row."""
    return wire.replace(" pty", "").replace("_multicast", "")


def seconds_of(seconds: float) -> float:
    """Duration for which a run is observed: intervals need more than single calls."""
    return 2.0 * seconds
