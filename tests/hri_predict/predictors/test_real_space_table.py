"""The baselines reproduce the data pack's table "Real time, real space" to the printed digit."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import Skeleton, make_skeleton
from hri_predict.contracts.predictor import Predictor
from hri_predict.predictors.baselines import (
    ConstantVelocity,
    ConstantVelocitySettings,
    ZeroVelocity,
    ZeroVelocitySettings,
)

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
CMU = DATA / "cmu_mocap"
RATE_HZ = 30.0
HORIZON_S = 1.0
HISTORY_S = 0.1
ACTIONS = ("basketball", "jumping", "running", "soccer", "walking", "washwindow")

pytestmark = pytest.mark.skipif(not CMU.exists(), reason="needs ../shared/data")


@pytest.fixture(scope="module")
def printed() -> dict[str, tuple[int, list[tuple[int, int]], list[float]]]:
    """Of each action: windows, (zero, constant) velocity per column, and the columns in seconds."""
    text = (DATA / "README.md").read_text(encoding="utf-8")
    lines = text[text.index("Real time, real space") :].splitlines()
    table = [[c.strip() for c in line.strip("|").split("|")] for line in lines if line[:1] == "|"]
    header = next(row for row in table if row[0] == "action")
    columns = [int(cell.removesuffix(" ms")) / 1000 for cell in header[2:]]
    result = {}
    for row in table:
        if row[0] in ACTIONS and row[0] not in result:
            pairs = [re.fullmatch(r"(\d+) / (\d+)", cell) for cell in row[2:]]
            cells = [(int(p[1]), int(p[2])) for p in pairs if p]
            result[row[0]] = (int(row[1]), cells, columns)
    assert set(result) == set(ACTIONS)
    return result


@pytest.fixture(scope="module")
def moving_joints() -> tuple[list[int], Skeleton]:
    """The 25 joints and their tree."""
    skeleton = json.loads((CMU / "skeleton.json").read_text(encoding="utf-8"))
    indices = skeleton["benchmark_joints_25"]
    names = [skeleton["joints"][i] for i in indices]
    return indices, make_skeleton("cmu25", names, skeleton["benchmark_parents_25"])


def errors_mm(predictor: Predictor, frames: Floats, columns: list[float]) -> tuple[int, list[int]]:
    """Windows, and the mean joint error at each column, over all origins 4 ... n - 31."""
    origins = range(4, len(frames) - 30)
    steps, ahead = predictor.history_steps, predictor.horizon_steps
    history = np.stack([frames[o - steps + 1 : o + 1] for o in origins])
    truth = np.stack([frames[o + 1 : o + 1 + ahead] for o in origins])
    forecast = predictor.predict(history, np.ones(history.shape[:3], bool)).positions
    mean = 1000 * np.linalg.norm(forecast - truth, axis=-1).mean(axis=(0, 2))
    return len(origins), [round(float(mean[round(c * RATE_HZ) - 1])) for c in columns]


@pytest.mark.parametrize("action", ACTIONS)
def test_table_to_the_printed_digit(action, printed, moving_joints):
    indices, skeleton = moving_joints
    with np.load(CMU / "test" / f"{action}_1.npz") as file:
        frames = file["positions_world"][1:].astype(np.float64)[::4, indices]
    common = {"rate_hz": RATE_HZ, "horizon_s": HORIZON_S, "history_s": HISTORY_S}
    zero = ZeroVelocity(ZeroVelocitySettings(name="zero_velocity", **common), skeleton)
    constant = ConstantVelocity(
        ConstantVelocitySettings(name="constant_velocity", span_s=0.1, **common), skeleton
    )
    windows, cells, columns = printed[action]
    assert errors_mm(zero, frames, columns) == (windows, [z for z, _ in cells])
    assert errors_mm(constant, frames, columns) == (windows, [c for _, c in cells])
