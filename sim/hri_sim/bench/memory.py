"""``bench memory``: resident memory over hours of node time."""

from typing import Annotated

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.node.listeners import Tick
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.bench.table import JsonOption, facts
from hri_sim.fault_table.resident import Resident

# Before this, bounded buffers (durations of ticks, round trips, history) are still filling up.
WARM_UP_S = 360.0


class _MemoryView(View):
    """Samples the resident memory once a minute of node time."""

    def __init__(self, warm_up_s: float) -> None:
        self.memory = Resident(60.0, warm_up_s)

    def on_tick(self, tick: Tick) -> None:
        """Take a sample when a minute has passed."""
        self.memory.look(tick.now_ns)


def memory(
    hours: Annotated[
        float, typer.Option(help="Hours of node time to run, as fast as possible.")
    ] = 1.0,
    as_json: JsonOption = False,
) -> None:
    """Measure resident memory over a long run of the demo's cell on the virtual clock.

    The predictor is constant_velocity.

    Example: hri-predict bench memory --hours 1
    """
    if not 0.2 <= hours <= 1000:
        raise ConfigError(f"--hours {hours}: give 0.2 to 1000")
    view = _MemoryView(max(WARM_UP_S, 360.0 * hours))
    config = configuration.load(configuration.shipped("demo.yaml")).quiet()
    config = config.with_predictor("constant_velocity")
    run(config, Options(factor=None, duration_s=hours * 3600.0, view=view))
    facts({"hours": hours} | view.memory.growth(), as_json)
