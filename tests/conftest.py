"""For all tests: every process computes on one core, so that tests can run side by side."""

import os

# before torch and numpy are imported; processes that tests start inherit it
os.environ.setdefault("OMP_NUM_THREADS", "1")
