"""The demo with a baseline predictor.

Measurements of the node itself (faults, deaths, levels) should not change with each newly trained
network, nor wait for its inference.
"""

from typing import Any

from hri_predict.run import config as configuration
from hri_predict.run.config import Config

BASELINE: dict[str, Any] = {"name": "constant_velocity", "span_s": 0.1, "horizon_s": 1.2}
"""The ``predictor:`` block of a configuration."""


def baseline_demo() -> Config:
    """Return ``configs/demo.yaml`` with ``BASELINE`` and without alert lines."""
    return configuration.load(configuration.shipped("demo.yaml")).quiet().with_predictor(**BASELINE)
