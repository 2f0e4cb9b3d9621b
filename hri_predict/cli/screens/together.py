"""Several views of the same run."""

from collections.abc import Sequence

from hri_predict.node.listeners import Tick
from hri_predict.run.assemble import Assembly
from hri_predict.run.session import View


class Together(View):
    """Forwards everything to each of its views, of which there may be none."""

    def __init__(self, views: Sequence[View]) -> None:
        self._views = tuple(views)

    def bind(self, assembly: Assembly) -> None:
        """Pass the assembly to all views."""
        for view in self._views:
            view.bind(assembly)

    def on_tick(self, tick: Tick) -> None:
        """Pass a tick to all views."""
        for view in self._views:
            view.on_tick(tick)
