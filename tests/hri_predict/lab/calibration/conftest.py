from pathlib import Path

import numpy as np
import pytest

from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.recording.recording import Recording
from tests.hri_predict.short_fit import short_fit


def recording_of(positions, rate_hz=25.0, name="walking_1", observed=None, stamps_ns=None):
    """A recording of one person from canonical joints (F, J, 3) in metres."""
    frames = range(len(positions))
    seen = np.ones(positions.shape[:2], bool) if observed is None else observed
    stamps = [round(k * 1e9 / rate_hz) for k in frames] if stamps_ns is None else stamps_ns
    scenes = [Scene(stamps[k], k, True, (Person(1, positions[k], seen[k]),)) for k in frames]
    return Recording(
        path=Path(f"{name}.npz"),
        kind="cmu",
        joint_map=load_joint_map("canonical"),
        rate_hz=rate_hz,
        scenes=scenes,
        arrival_ns=stamps,
    )


@pytest.fixture(scope="session")
def make_recording():
    return recording_of


@pytest.fixture(scope="package", autouse=True)
def _short_fit():
    with short_fit():
        yield
