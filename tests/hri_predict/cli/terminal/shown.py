"""The live view of the demo at a moment."""

import io

from rich.console import Console, RenderableType

from hri_predict.base.clock import VirtualClock
from hri_predict.cli.terminal.view import TerminalView
from hri_predict.contracts import registry
from hri_predict.node.listeners import Listener, Tick
from hri_predict.protocol.messages import NodeState
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.config import Config
from hri_predict.run.runtime import run_virtual

NOON_S = 1_772_971_200


def demo() -> Config:
    """The demo's configuration, which writes nothing."""
    return configuration.load(configuration.shipped("demo.yaml")).quiet()


def view_after(
    config: Config, seconds: float, size: tuple[int, int] = (80, 24)
) -> tuple[TerminalView, RenderableType]:
    """The live view after so many seconds, which begin at noon, and its page while it ran."""
    clock = VirtualClock(10**9)
    cell = registry.load("cells", "mock")(
        links=list(config.links), robots=config.node.robots, base_dir=config.base_dir, clock=clock
    )
    view = TerminalView(
        Console(file=io.StringIO(), width=size[0], height=size[1]),
        lambda: NOON_S - 1.0 + clock.now_ns() * 1e-9,
    )
    assembly = assemble.build(
        config,
        clock,
        transports=cell.transports(),
        deadline=False,
        listeners=[running := _WhileItRuns(view)],
    )
    view.bind(assembly)
    run_virtual(assembly, cell, duration_s=seconds)
    cell.stop()
    assert running.page is not None
    return view, running.page


class _WhileItRuns(Listener):
    """Hands ticks to a view, but not the one that says that the node stops."""

    def __init__(self, view: TerminalView) -> None:
        self._view = view
        self.page: RenderableType | None = None

    def on_tick(self, tick: Tick) -> None:
        if tick.status.node_state is not NodeState.STOPPING:
            self._view.on_tick(tick)
            self.page = self._view.page()
