"""For all tests: they run side by side, and on machines that are busy with other things."""

import os
import signal

import pytest
from hypothesis import HealthCheck, settings

# each process computes on one core; before torch and numpy are imported, and inherited
os.environ.setdefault("OMP_NUM_THREADS", "1")

# a shell without job control ignores Ctrl-C for what it starts in the background, and so would
# every process that a test starts and ends by it
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# how long an example takes, or takes to make, says nothing about the code here
# Each run draws other examples; `EXAMPLES=1000 make pytest` draws many.
settings.register_profile(
    "patient",
    settings(),
    max_examples=int(os.environ.get("EXAMPLES", "40")),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("patient")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes longest begins first, so that no worker is left with it alone at the end."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
