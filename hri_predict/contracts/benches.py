"""Contracts of the benches that ``hri_sim`` brings (``hri_predict.simulations``)."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol


class LinkBench(Protocol):
    """Measures links in real time: entry point ``links``, a module.

    Attributes:
        BAUDRATES: values that ``capacities`` goes through.
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
        TOPOLOGIES, RATES_HZ: values that ``costs`` goes through.
    """

    @property
    def TOPOLOGIES(self) -> Sequence[str]: ...  # noqa: D102

    @property
    def RATES_HZ(self) -> Sequence[float]: ...  # noqa: D102

    def costs(self, seconds: float, /) -> Iterator[dict[str, Any]]:
        """A row of figures for each topology and rate."""

    def recovery(self, times: int, /) -> dict[str, list[float]]:
        """Seconds until a cell is heard after it joins, and after the router returns."""


class FleetPageBench(Protocol):
    """Measures the page of many cells in real time: entry point ``fleet_page``, a module."""

    def page(self, cells: int, seconds: float, /) -> dict[str, Any]:
        """A row of figures: processor time and delays."""


class TrackerBench(Protocol):
    """Measures trackers in closed loop: entry point ``trackers``, a module."""

    def cases(self, only: str | None, /) -> list[tuple[str, str]]:
        """Each tracker with each noise; with ``only``, those in whose names this is found."""

    def rows(
        self, chosen: Sequence[tuple[str, str]], walks: int, predictor: str, /
    ) -> Iterator[dict[str, Any]]:
        """A row of figures for each of these cases."""


class NodeBench(Protocol):
    """Measures the whole node in real time: entry point ``node``, a module.

    Attributes:
        WIRES: wires of ``heard``: a serial line, a CAN bus, and a CAN adapter on a serial line.
        AGE_WIRES: wires of ``ages``.
    """

    @property
    def WIRES(self) -> Sequence[str]: ...  # noqa: D102

    @property
    def AGE_WIRES(self) -> Sequence[str]: ...  # noqa: D102

    def config(self, **wanted: Any) -> Any:
        """A cell's ``run.config.Config`` with these people, robots, predictor, rate_hz, ..."""

    def heard(
        self,
        *,
        wire: str,
        predictor: str,
        rate_hz: float,
        seconds: float,
        cache: Path | None = None,
        watched: bool = False,
    ) -> dict[str, Any]:
        """A node in a process of its own, as another process hears it; figures by name.

        Raises:
            LinkError: this machine has no such wire, or the node did not start; says why.
        """

    def ages(
        self,
        *,
        wires: tuple[str, ...],
        rates_hz: tuple[float, ...],
        predictors: tuple[str, ...],
        seconds: float,
    ) -> Iterator[dict[str, Any]]:
        """A row of figures for each of these cases, or why there is no such wire."""
