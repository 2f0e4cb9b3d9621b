"""The demo with a baseline for its predictor.

What is measured of the node itself (its faults, its deaths, its levels) should not change with each
newly trained network, nor wait for one.
"""

from typing import Any

from hri_predict import config as configuration
from hri_predict.config import Config

BASELINE: dict[str, Any] = {"name": "constant_velocity", "span_s": 0.1, "horizon_s": 1.2}
"""``predictor:`` of a configuration."""


def baseline_demo() -> Config:
    """``configs/demo.yaml``, its links quiet, with ``BASELINE``."""
    return configuration.load(configuration.shipped("demo.yaml")).quiet().with_predictor(**BASELINE)
