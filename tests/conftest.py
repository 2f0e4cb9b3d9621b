"""For all tests: they run side by side, and on machines that are busy with other things."""

import os

from hypothesis import HealthCheck, settings

# each process computes on one core; before torch and numpy are imported, and inherited
os.environ.setdefault("OMP_NUM_THREADS", "1")

# how long an example takes, or takes to make, says nothing about the code here
settings.register_profile(
    "patient", settings(), deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("patient")
