from dataclasses import replace

import numpy as np
import pytest

from hri_predict.risk.settings import LEVELS
from hri_predict.risk.zones.calibration import Calibration, UsedRecording, plain
from hri_predict.risk.zones.motion_class import CLASSES, SPEED_CLASSES
from hri_predict.skeleton import JOINTS

PLAIN = tuple(dict.fromkeys(plain(name) for name in JOINTS))


def calibration_of(recordings=120, steps=25, step_m=0.01, joints=PLAIN, **changes):
    """A calibration whose radii tell where they come from.

    Of level i, class c, joint g and step k (from 0): ``step_m`` (k + 1) + 0.2 i + 0.04 c + 0.001 g.
    The body's are 1 m more, the guaranteed ones 2 m more.
    """
    shape = (len(LEVELS), len(CLASSES), len(joints), steps)
    i, c, g, k = np.indices(shape)
    estimated = step_m * (k + 1) + 0.2 * i + 0.04 * c + 0.001 * g
    guaranteed = 2.0 + estimated[:, :: len(CLASSES) // len(SPEED_CLASSES)]
    assert guaranteed.shape[1] == len(SPEED_CLASSES)
    made = Calibration(
        predictor="zero_velocity",
        settings={"rate_hz": 25.0, "history_s": 0.5},
        weights=None,
        rate_hz=25.0,
        joints=tuple(joints),
        thresholds_m=np.array([[0.1, 0.2], [0.3, 0.6], [0.3, 0.6]]),
        estimated={"joint": estimated, "body": 1.0 + estimated},
        guaranteed={"joint": guaranteed, "body": 1.0 + guaranteed},
        recordings=tuple(
            UsedRecording(name=f"walking_{n}", windows=(3,) * len(CLASSES))
            for n in range(recordings)
        ),
        ranges={"speed_m_s": {"wrist": 4.0}, "bone_m": {"wrist": [0.2, 0.3]}, "ratio_short": 1.5},
    )
    return replace(made, **changes)


@pytest.fixture(scope="session")
def make_calibration():
    return calibration_of
