"""The log of a merged source's doubts: each when it begins, at most once a minute.

The node's log limits lines by their wording, which all doubts have in common: without a limit for
each, two sensors that agree and disagree in turns would hide that a third one is silent.
"""

import logging
from collections.abc import Sequence

from hri_predict.contracts.scene import Doubt

log = logging.getLogger(__name__)

EVERY_NS = 60_000_000_000
"""A doubt that begins again sooner is counted."""


class DoubtLog:
    """One thread only."""

    def __init__(self) -> None:
        self._now: set[str] = set()
        # doubt -> when it was logged, how often it began since
        self._said: dict[str, list[int]] = {}

    def note(self, doubts: Sequence[Doubt], time_ns: int) -> None:
        """Log doubts that begin, counts whose minute is over, and that all doubts are over."""
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
