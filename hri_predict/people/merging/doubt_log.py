"""Logs a merged source's doubts: each when it starts, at most once a minute.

The node's log limits lines by their message template, which all doubts share: without a limit for
each doubt, two sensors that alternately agree and disagree would hide that a third is silent.
"""

import logging
from collections.abc import Sequence

from hri_predict.contracts.scene import Doubt

log = logging.getLogger(__name__)

EVERY_NS = 60_000_000_000
"""Interval within which a doubt that starts again is only counted."""


class DoubtLog:
    """One thread only."""

    def __init__(self) -> None:
        self._now: set[str] = set()
        # doubt -> when it was logged, how often it began since
        self._said: dict[str, list[int]] = {}

    def note(self, doubts: Sequence[Doubt], time_ns: int) -> None:
        """Log new doubts, counts at the end of their minute, and the end of all doubts."""
        # without the centimetres, which change
        now = {doubt.text.split(" are ")[0]: doubt.text for doubt in doubts}
        for key, (said_ns, again) in list(self._said.items()):
            if time_ns - said_ns >= EVERY_NS:
                del self._said[key]
                if again:
                    log.warning("source 'merged': %s: %d more times within a minute", key, again)
        for key in sorted(now.keys() - self._now):
            if key in self._said:
                self._said[key][1] += 1
            else:
                self._said[key] = [time_ns, 0]
                log.warning("source 'merged': %s", now[key])
        if self._now and not now:
            log.info("source 'merged': all sensors are heard and agree")
        self._now = set(now)
