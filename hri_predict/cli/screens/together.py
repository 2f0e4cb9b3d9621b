"""Several views of one run."""

from collections.abc import Sequence

from hri_predict.node.listeners import Tick
from hri_predict.run.assemble import Assembly
from hri_predict.run.session import View


class Together(View):
    """Hands everything on to each of these views; there may be none."""

    def __init__(self, views: Sequence[View]) -> None:
        self._views = tuple(views)

    def bind(self, assembly: Assembly) -> None:
        """Take the assembly for all of them."""
        for view in self._views:
            view.bind(assembly)

    def on_tick(self, tick: Tick) -> None:
        """Hand a tick on to all of them."""
        for view in self._views:
            view.on_tick(tick)
