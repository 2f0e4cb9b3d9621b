"""Run the node with its real links for measurements: on real devices or on mock controllers.

On the virtual clock, mock controllers run in the node's thread: tests are fast and repeatable.
"""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from hri_predict.base.clock import Clock, VirtualClock
from hri_predict.contracts import registry
from hri_predict.contracts.cell import Cell, ControllerReport
from hri_predict.contracts.link import Link, Simulatable, Transport
from hri_predict.node.listeners import Listener
from hri_predict.run import assemble
from hri_predict.run.assemble import Assembly
from hri_predict.run.config import Config
from hri_predict.run.runtime import run_real_time, run_virtual, stop_on_signals

Wrap = Callable[[str, Transport[Any]], Transport[Any]]
"""Wraps the wire of the link with this name."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """A cell with its running controllers, and the wires to them."""

    config: Config
    clock: Clock
    cell: Cell | None
    transports: Mapping[str, Transport[Any]]

    def links(self) -> list[Link]:
        """Return the configured links on these wires, for code that wraps them."""
        return [
            assemble.build_link(self.config, link, self.clock, transport=self.transports[link.name])
            for link in self.config.links
        ]

    def run(
        self,
        *,
        seconds: float,
        listeners: Sequence[Listener],
        links: Sequence[Link] | None = None,
        shadow: bool = False,
        each_tick: Callable[[int], None] | None = None,
        stop: threading.Event | None = None,
    ) -> Assembly:
        """Run the node for this time, or until ``stop`` is set (in real time).

        Raises:
            HriPredictError: it cannot start; one line with the remedy.
            KeyboardInterrupt: a signal ended it; the controllers were notified.
        """
        virtual = isinstance(self.clock, VirtualClock)
        assembly = assemble.build(
            self.config,
            self.clock,
            transports=self.transports,
            links=links,
            deadline=not virtual,
            shadow=shadow,
            listeners=listeners,
        )
        if virtual:
            run_virtual(assembly, self.cell, duration_s=seconds, each_tick=each_tick)
        else:
            stop = stop or threading.Event()
            with _aborted_by_signals(stop):
                run_real_time(assembly=assembly, stop=stop, duration_s=seconds, each_tick=each_tick)
        return assembly

    def reports(self) -> Sequence[ControllerReport]:
        """Stop the mock controllers and return the result of each."""
        return () if self.cell is None else self.cell.stop()


class _Asked(threading.Event):
    """Set by a signal; it also ends the run."""

    def __init__(self, stop: threading.Event) -> None:
        super().__init__()
        self._stop = stop

    def set(self) -> None:
        """See ``threading.Event``."""
        super().set()
        self._stop.set()


@contextmanager
def _aborted_by_signals(stop: threading.Event) -> Iterator[None]:
    """Let a signal end the run as the node always ends: robots may be moving.

    Raises:
        KeyboardInterrupt: a signal came, so the measurement is incomplete.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    asked = _Asked(stop)
    try:
        with stop_on_signals(asked):
            yield
    except SystemExit as ended:  # during the start
        raise KeyboardInterrupt from ended
    if asked.is_set():
        raise KeyboardInterrupt


@contextmanager
def bench(config: Config, clock: Clock, wrap: Wrap | None = None) -> Iterator[Bench]:
    """Start the mock controllers of a configuration, if any, and connect to all controllers.

    Raises:
        HriPredictError: a controller did not start, or a link cannot be built.
    """
    config = quiet(config)
    cell = _cell(config, clock)
    virtual = isinstance(clock, VirtualClock)
    try:
        if cell is not None and virtual:
            transports = dict(cell.transports())
        else:
            ports = cell.start() if cell is not None else {}
            transports = {
                link.name: _device(config, i, ports.get(link.name))
                for i, link in enumerate(config.links)
            }
        if wrap is not None:
            transports = {name: wrap(name, wire) for name, wire in transports.items()}
        yield Bench(config=config, clock=clock, cell=cell, transports=transports)
    finally:
        if cell is not None:
            cell.stop()


def quiet(config: Config) -> Config:
    """Return the configuration without parts that write files or send messages elsewhere."""
    alerts = type(config.node.alerts)(terminal=False)
    return config.with_node(alerts=alerts, record=None, evidence=None, state=None, discovery=None)


def _cell(config: Config, clock: Clock) -> Cell | None:
    simulated = [link for link in config.links if link.simulate is not None]
    if not simulated:
        return None
    return registry.load("cells", "mock")(
        links=simulated, robots=config.node.robots, base_dir=config.base_dir, clock=clock
    )


def _device(config: Config, index: int, port: str | None) -> Transport[Any]:
    settings = config.links[index]
    cls = registry.load("links", settings.kind)
    if port is not None and isinstance(cls, Simulatable):
        settings = settings.model_copy(update={cls.port_field: port})
    with registry.building(f"link '{settings.name}'"):
        return cls.make_transport(assemble.completed(config, settings))
