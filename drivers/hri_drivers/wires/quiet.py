"""Quiet for libraries that log each error that they raise, or that the link counts."""

import logging


def quiet(library: str) -> None:
    """Let a library log nothing: the link says what there is to say, once."""
    log = logging.getLogger(library)
    log.addHandler(logging.NullHandler())
    log.setLevel(logging.CRITICAL)
    log.propagate = False
