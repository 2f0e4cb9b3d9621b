from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.zones.calibration import Calibration, UsedRecording, plain
from hri_predict.zones.learned_scale import AHEAD, KINDS, NOW, ScaleNetwork
from hri_predict.zones.motion_class import SPEED_CLASSES
from hri_predict.zones.settings import LEVELS

PLAIN = tuple(dict.fromkeys(plain(name) for name in JOINTS))


def scale_of(log_of_kind=None, **log_of_input):
    """A network whose scale is 1 m times e^(what is added for a kind of joint or an input).

    An input's part counts where the input is above 0.
    """
    plain_inputs, width = len(NOW) + len(AHEAD), len(NOW) + len(AHEAD) + len(KINDS)
    first, second = np.zeros((width, width)), np.zeros((width, 1))
    for i, name in enumerate((*NOW, *AHEAD)):
        if name in log_of_input:
            first[i, i], second[i] = 1.0, log_of_input[name]
    for kind, log in (log_of_kind or {}).items():
        i = plain_inputs + KINDS.index(kind)
        first[i, i], second[i] = 1.0, log
    return ScaleNetwork(
        mean=np.zeros(plain_inputs),
        deviation=np.ones(plain_inputs),
        layers=((first, np.zeros(width)), (second, np.zeros(1))),
    )


def calibration_of(recordings=120, steps=25, step_m=0.01, joints=PLAIN, **changes):
    """A calibration whose radii tell where they come from.

    The scale is 1 m. The factor of level i, speed class c and step k (from 0) is
    ``step_m`` (k + 1) + 0.2 i + 0.04 c. The body's are 1 more. The guaranteed radii are those and
    0.001 g for joint g, 2 m more.
    """
    i, c, g, k = np.indices((len(LEVELS), len(SPEED_CLASSES), len(joints), steps))
    estimated = (step_m * (k + 1) + 0.2 * i + 0.04 * c)[:, :, 0]
    guaranteed = 2.0 + step_m * (k + 1) + 0.2 * i + 0.04 * c + 0.001 * g
    made = Calibration(
        predictor="zero_velocity",
        settings={"rate_hz": 25.0, "history_s": 0.5},
        weights=None,
        rate_hz=25.0,
        joints=tuple(joints),
        scale=scale_of(),
        estimated={"joint": estimated, "body": 1.0 + estimated},
        guaranteed={"joint": guaranteed, "body": 1.0 + guaranteed},
        recordings=tuple(
            UsedRecording(name=f"walking_{n}", windows=(3,) * len(SPEED_CLASSES))
            for n in range(recordings)
        ),
        ranges={"speed_m_s": {"wrist": 4.0}, "ratio_short": 1.5},
    )
    return replace(made, **changes)


@pytest.fixture(scope="session")
def make_calibration():
    return calibration_of
