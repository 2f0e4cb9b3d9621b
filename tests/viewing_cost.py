"""What screens cost the node: late ticks and jitter with them and without, in turns.

    python -m tests.viewing_cost --rounds 3 --seconds 8

The cell is the demo's, without links, and no browser is open.
"""

import argparse
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from hri_predict.cli.screens.together import Together
from hri_predict.node.listeners import Tick
from hri_predict.run.assemble import Assembly
from hri_predict.run.session import Options, View, run
from hri_predict.viewing.feed import OPERATOR, VIEWER, Feed, ScreenSettings
from tests.hri_predict.viewing.staged import cell

START_S = 4.0
"""A screen's own start takes a core for seconds; it is not what is measured."""


class _Gaps(View):
    """When ticks were told, by a clock of its own."""

    def __init__(self) -> None:
        self.at_ns: list[int] = []

    def bind(self, assembly: Assembly) -> None:
        """Nothing is needed."""

    def on_tick(self, tick: Tick) -> None:
        self.at_ns.append(time.monotonic_ns())


def once(folder: Path, seconds: float, *, screens: bool, stuck: bool) -> tuple[np.ndarray, int]:
    """Milliseconds between ticks less their nominal value, and how many ticks were late."""
    gaps = _Gaps()
    with ExitStack() as stack:
        views: list[View] = [gaps]
        if screens:
            settings = [ScreenSettings(m, m, 0) for m in (VIEWER, OPERATOR)]
            feed = stack.enter_context(Feed(settings))
            views.append(feed)
            time.sleep(START_S)
            if stuck:
                for screen in feed.screens:
                    screen.process.send_signal(19)  # SIGSTOP
        config = cell(folder).without_links().quiet()
        summary = run(config, Options(duration_s=seconds, view=Together(views)))
        if stuck:
            for screen in feed.screens:
                screen.process.send_signal(18)
    apart = np.diff(gaps.at_ns[25:]) * 1e-6  # the first second starts things
    return apart - 1e3 / config.node.rate_hz, summary.late_ticks


def main() -> None:
    """Print medians and tails, and their ratios."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=8.0)
    args = parser.parse_args()
    ways = {"none": (False, False), "screens": (True, False), "hung screens": (True, True)}
    apart: dict[str, list[np.ndarray]] = {name: [] for name in ways}
    late = dict.fromkeys(ways, 0)
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(args.rounds):
            for name, (screens, stuck) in ways.items():
                found, count = once(Path(folder), args.seconds, screens=screens, stuck=stuck)
                apart[name].append(np.abs(found))
                late[name] += count
    base = np.percentile(np.concatenate(apart["none"]), [50, 99])
    print(f"{'':14}{'p50 ms':>10}{'p99 ms':>10}{'late':>6}{'ratio p50':>11}{'ratio p99':>11}")
    for name, parts in apart.items():
        p50, p99 = np.percentile(np.concatenate(parts), [50, 99])
        ratios = f"{p50 / base[0]:11.2f}{p99 / base[1]:11.2f}"
        print(f"{name:14}{p50:10.3f}{p99:10.3f}{late[name]:6d}{ratios}")


if __name__ == "__main__":
    main()
