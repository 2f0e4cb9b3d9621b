"""``bench memory``: resident memory over hours of node time."""

import json
import resource
from pathlib import Path
from typing import Annotated

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.node.listeners import Tick
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run

# Before this, bounded buffers (durations of ticks, round trips, history) are still filling up.
WARM_UP_MINUTES = 6


class _MemoryView(View):
    """Samples the resident memory once a minute of node time."""

    def __init__(self) -> None:
        self.samples: list[float] = []
        self._due_ns = 0

    def on_tick(self, tick: Tick) -> None:
        """Take a sample when a minute has passed."""
        if tick.now_ns >= self._due_ns:
            self._due_ns = tick.now_ns + 60_000_000_000
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            self.samples.append(pages * resource.getpagesize() / 2**20)


def memory(
    hours: Annotated[
        float, typer.Option(help="Hours of node time to run, as fast as possible.")
    ] = 1.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON.")] = False,
) -> None:
    """Measure resident memory over a long run of the demo's cell on the virtual clock.

    The predictor is constant_velocity.

    Example: hri-predict bench memory --hours 1
    """
    if not 0.2 <= hours <= 1000:
        raise ConfigError(f"--hours {hours}: give 0.2 to 1000")
    view = _MemoryView()
    config = configuration.load(configuration.shipped("demo.yaml")).quiet()
    config = config.with_predictor("constant_velocity")
    run(config, Options(factor=None, duration_s=hours * 3600.0, view=view))
    warm = max(WARM_UP_MINUTES, len(view.samples) // 10)
    early, late = view.samples[warm], view.samples[-1]
    result = {
        "hours": hours,
        "rss_mib_early": round(early, 2),
        "rss_mib_end": round(late, 2),
        "growth_percent": round(100.0 * (late / early - 1.0), 2),
    }
    if as_json:
        print(json.dumps(result))
        return
    for name, value in result.items():
        print(f"{name.replace('_', ' ')}: {value}")
