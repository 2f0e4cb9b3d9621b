"""The line that this machine cannot keep the node's rate, with the remedy that fits the cause.

It is logged while ticks are late, and printed above the summary of the run.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from hri_predict.base.files import data_path
from hri_predict.base.machine.realtime import GUIDE
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import PredictorSettings
from hri_predict.node.shedding import HIGH
from hri_predict.operation.monitoring.pace import Pace
from hri_predict.run.assemble import LATE_FRACTION
from hri_predict.run.config import Config

log = logging.getLogger(__name__)

WINDOW_NS, WINDOW_SHARE = 5_000_000_000, 0.1
"""A warning is logged if more than this share of the ticks of such a time were late or missed,"""
AGAIN_NS = 60_000_000_000
"""and at most once in this time."""
LATE_TICKS, LATE_SHARE = 5, 0.01
"""If the late and missed ticks of a run exceed both limits, its summary has the line."""
LEAST_HZ = 10
"""Minimum of ``rate_hz`` and ``max_rate_hz``."""
_CHEAPEST = "constant_velocity"
_BASELINES = (_CHEAPEST, "zero_velocity", "kalman")


@dataclass(frozen=True, slots=True)
class Counts:
    """Numbers of ticks: begun, of these late, missed; and of late forecasts."""

    ticks: int = 0
    late: int = 0
    missed: int = 0
    forecasts: int = 0

    def since(self, before: Self) -> "Counts":
        """Return the increases."""
        return Counts(
            self.ticks - before.ticks,
            self.late - before.late,
            self.missed - before.missed,
            self.forecasts - before.forecasts,
        )

    @property
    def wanted(self) -> int:
        """Number of ticks that were due."""
        return self.ticks + self.missed


class TooSlow:
    """Compares the late and missed ticks of a run with the limits above.

    Args:
        config: of the node; names the settings that the remedy changes, and their values.
        source_rate_hz: nominal scenes per second.
        pace: counts the ticks.
        counters: counters of the predictor's runner.
    """

    def __init__(
        self,
        config: Config,
        source_rate_hz: float,
        pace: Pace,
        counters: Callable[[], Mapping[str, int]],
    ) -> None:
        self._config, self._source_rate_hz = config, source_rate_hz
        self._pace, self._counters = pace, counters
        self._before = Counts()
        self._since_ns: int | None = None
        self._quiet_until_ns = 0

    def note(self, now_ns: int) -> None:
        """Log the warning if it is due; called after each tick, which was counted before."""
        if self._since_ns is None:
            self._since_ns = now_ns
        if now_ns - self._since_ns < WINDOW_NS:
            return
        counts, lasted_s = self._counts(), (now_ns - self._since_ns) * 1e-9
        new = counts.since(self._before)
        self._before, self._since_ns = counts, now_ns
        if new.late + new.missed > WINDOW_SHARE * new.wanted and now_ns >= self._quiet_until_ns:
            self._quiet_until_ns = now_ns + AGAIN_NS
            log.warning("%s", self._line(new, f" in the last {lasted_s:.0f} s"))

    def of_run(self) -> str:
        """Return the line about the whole run; empty if the machine was fast enough."""
        counts = self._counts()
        if counts.late + counts.missed <= max(LATE_TICKS, LATE_SHARE * counts.wanted):
            return ""
        return self._line(counts, "")

    def _counts(self) -> Counts:
        pace, forecasts = self._pace, self._counters().get("predictor_late", 0)
        return Counts(pace.ticks, pace.late_ticks, pace.missed_ticks, forecasts)

    def _line(self, counts: Counts, when: str) -> str:
        took_ms = [*self._pace.tick_ms][-counts.ticks :] or [0.0]
        median_ms, p99_ms = np.percentile(took_ms, (50, 99))
        return (
            f"too slow: {counts.late} of {counts.wanted} ticks were late and {counts.missed} "
            f"missed{when}, which also makes input and robot states look late or their clocks "
            f"wrong; {self._remedy(counts, float(median_ms), float(p99_ms))}"
        )

    def _remedy(self, counts: Counts, median_ms: float, p99_ms: float) -> str:
        """Return the probable cause and what to change, the most effective change first."""
        period_ms, where = 1e3 / self._rate_hz, _where(self._config.path)
        slower = self._slower(p99_ms)
        cheaper = _cheaper(self._config.predictor) if counts.forecasts else ""
        # a tick waits for a forecast for at most LATE_FRACTION of its period: is the rest in time?
        fits_without = median_ms < (1 + LATE_FRACTION) * period_ms
        if cheaper and fits_without and 2 * counts.forecasts > counts.late:
            settings = ", or ".join(filter(None, (cheaper, slower)))
            return f"most forecasts were late: {settings}{where}; or stop other programs"
        if p99_ms < HIGH * period_ms:
            return (
                f"ticks took only {p99_ms:.0f} ms (p99) but began late: stop other programs, or "
                f"give the node priority ({GUIDE})"
            )
        took = f"ticks took {p99_ms:.0f} ms (p99)"
        if slower:
            settings = ", or ".join(filter(None, (slower, cheaper)))
            return f"{took}: {settings}{where}; or stop other programs"
        least = f"{took}, too long even for {LEAST_HZ} Hz, the minimum: stop other programs"
        return f"{least}, use a faster machine{f', or {cheaper}{where}' if cheaper else ''}"

    @property
    def _rate_hz(self) -> float:
        """Ticks per second above which a tick is late."""
        node = self._config.node
        if node.ticks == "fixed":
            return node.rate_hz
        return min(node.largest_rate_hz, max(node.rate_hz, self._source_rate_hz))

    def _slower(self, took_ms: float) -> str:
        """Return the rate at which such ticks shed no load; empty if no lower rate is allowed."""
        node, fits_hz = self._config.node, int(HIGH * 1e3 / max(took_ms, 1e-3))
        if not LEAST_HZ <= fits_hz < self._rate_hz:
            return ""
        if node.ticks == "fixed":
            return f"lower rate_hz to {fits_hz}"
        keys = "max_rate_hz" if fits_hz >= node.rate_hz else "rate_hz and max_rate_hz"
        return f"lower {keys} to {fits_hz}"


def _cheaper(predictor: PredictorSettings) -> str:
    """Return how to change to a predictor that costs less; empty if there is none."""
    if predictor.name in _BASELINES:
        return ""
    if members := predictor.runs():
        return f"set predictor.name to {members[0]} (or {_CHEAPEST}, the cheapest)" + _without(
            predictor, members[0], _CHEAPEST
        )
    return f"set predictor.name to {_CHEAPEST}" + _without(predictor, _CHEAPEST)


def _without(predictor: PredictorSettings, *names: str) -> str:
    """Return which of the predictor's settings those of these names do not have."""
    known = [registry.predictor_settings(name).model_fields.keys() for name in names]
    alien = [key for key in sorted(predictor.model_fields_set) if any(key not in k for k in known)]
    return "".join(f" and remove predictor.{key}" for key in alien)


def _where(path: Path) -> str:
    """Return the file to change: a shipped one is copied first, also for ``demo`` and ``try``."""
    if path.parent != data_path():
        return f" in {path}"
    shipped = path if path.is_file() else data_path("demo.yaml")
    return f" in a copy of {shipped}, which run and replay accept"
