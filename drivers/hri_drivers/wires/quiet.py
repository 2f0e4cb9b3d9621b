"""Silences libraries that log errors which they also raise or which the link counts."""

import logging


def quiet(library: str) -> None:
    """Silence a library's log: the link itself reports each problem, once."""
    log = logging.getLogger(library)
    log.addHandler(logging.NullHandler())
    log.setLevel(logging.CRITICAL)
    log.propagate = False
