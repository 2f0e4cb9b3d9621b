"""Detects another sender that uses this node's ids, on any of its links."""

import logging
from collections.abc import Sequence

from hri_predict.contracts.link import Link

HOLD_NS = 2_000_000_000
"""Time for which the node stops the robots after the last such frame: twice as long as a receiver
keeps a schema (``protocol.reception.FORGET_S``), so that no receiver still follows the other
sender.
"""

log = logging.getLogger(__name__)


class SecondSender:
    """Watches the links for a second sender.

    Two nodes with the same ids contradict each other: one may see a person where the other sees
    none. Neither can know which of them a controller believes, so both must stop the robots.
    """

    def __init__(self, links: Sequence[Link]) -> None:
        self._links = links
        self._heard: frozenset[str] = frozenset()

    def heard(self, now_ns: int) -> bool:
        """Whether another sender was heard within ``HOLD_NS``."""
        heard = frozenset(
            link.name
            for link in self._links
            if link.foreign_ns is not None and now_ns - link.foreign_ns < HOLD_NS
        )
        for name in sorted(heard - self._heard):
            log.error("link %s: another sender uses this node's ids; the robots stop", name)
        for name in sorted(self._heard - heard):
            log.warning("link %s: the other sender is silent again", name)
        self._heard = heard
        return bool(heard)
