"""A cell with a cheap predictor, and motions that need no recording."""

import numpy as np
import pytest

from hri_predict.run import config as configuration
from hri_sim.simulation.cell import Cell

WALK_UP = "procedural:1"
ANOTHER = "procedural:2"


@pytest.fixture(scope="session")
def cell():
    """The shipped cell with ``constant_velocity``."""
    config = configuration.load(configuration.shipped("simulate.yaml")).quiet()
    return Cell(config.with_predictor("constant_velocity", horizon_s=1.2))


@pytest.fixture
def recording(tmp_path):
    """Two seconds of arms that a camera saw: (path, 30 Hz)."""
    rest = np.array([[x, y, 0.7] for y in (0.25, 0.1, -0.1) for x in (0.2, -0.2)])
    times = np.arange(60) / 30
    positions = rest + 0.1 * np.sin(times)[:, None, None]
    path = tmp_path / "arms.npz"
    np.savez(path, positions=positions.astype(np.float32), fps=np.float32(30))
    return path
