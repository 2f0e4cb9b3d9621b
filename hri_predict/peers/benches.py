"""Contracts of the benches that ``hri_sim`` brings (``hri_predict.simulations``)."""

from collections.abc import Iterator, Sequence
from typing import Any, Protocol


class LinkBench(Protocol):
    """Measures links in real time: entry point ``links``, a module.

    Attributes:
        BAUDRATES: what ``capacities`` goes through.
    """

    @property
    def BAUDRATES(self) -> Sequence[int]: ...  # noqa: D102

    def kinds(self) -> list[str]:
        """Kinds of link whose delays can be measured."""

    def delays(
        self, names: list[str], rates_hz: Sequence[float], seconds: float, /, **load: Any
    ) -> Iterator[dict[str, Any]]:
        """A row of figures for each of these kinds and rates, or why there is no such wire.

        ``load``: ``ticks``, ``predictor`` and number of ``people`` of the node.
        """

    def capacities(self, seconds: float, /) -> Iterator[dict[str, Any]]:
        """A row of figures for each baud rate: how full a serial wire gets."""


class FleetBench(Protocol):
    """Measures the zenoh link in real time: entry point ``fleet``, a module.

    Attributes:
        TOPOLOGIES, RATES_HZ: what ``costs`` goes through.
    """

    @property
    def TOPOLOGIES(self) -> Sequence[str]: ...  # noqa: D102

    @property
    def RATES_HZ(self) -> Sequence[float]: ...  # noqa: D102

    def costs(self, seconds: float, /) -> Iterator[dict[str, Any]]:
        """A row of figures for each topology and rate."""

    def recovery(self, times: int, /) -> dict[str, list[float]]:
        """Seconds until a cell is heard after it joins, and after the router returns."""


class TrackerBench(Protocol):
    """Measures trackers in closed loop: entry point ``trackers``, a module."""

    def cases(self, only: str | None, /) -> list[tuple[str, str]]:
        """Each tracker with each noise; with ``only``, those in whose names this is found."""

    def rows(
        self, chosen: Sequence[tuple[str, str]], walks: int, predictor: str, /
    ) -> Iterator[dict[str, Any]]:
        """A row of figures for each of these cases."""
