"""The demo with a baseline as its predictor.

Measurements of the node itself (faults, deaths, levels) should neither change with each newly
trained network nor wait for one.
"""

from typing import Any

from hri_predict.run import config as configuration
from hri_predict.run.config import Config

BASELINE: dict[str, Any] = {"name": "constant_velocity", "span_s": 0.1, "horizon_s": 1.2}
"""``predictor:`` of a configuration."""


def baseline_demo() -> Config:
    """Return ``configs/demo.yaml`` with ``BASELINE`` and without alert lines."""
    return configuration.load(configuration.shipped("demo.yaml")).quiet().with_predictor(**BASELINE)
