"""What the forms of ``calibrate`` have in common: predictor, recordings, scores."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from hri_predict.cli.common import files, predictor_settings, progress, warn
from hri_predict.errors import ConfigError
from hri_predict.joint_map import JointMap
from hri_predict.predictors.base import PredictorSettings

if TYPE_CHECKING:
    from hri_predict.calibration.scores import Scores
    from hri_predict.predictors.base import Predictor

RATE_HZ = 25.0
HORIZON_S = 1.2
LEAST_HORIZON_S = 0.2
"""Shorter zones protect nobody: robots take longer to stop."""


class Data(NamedTuple):
    """Which recordings, and how their joints are named."""

    entries: Sequence[Path]
    split: str | None
    joint_map: JointMap | None


def calibrated_settings(predictor: str, weights: Path | None, horizon: float) -> PredictorSettings:
    """The settings of a predictor at the rate of calibrations.

    Raises:
        ConfigError: the horizon is too short, or the predictor cannot reach it.
    """
    if not horizon >= LEAST_HORIZON_S:
        raise ConfigError(f"--horizon {horizon:g}: too short; give {LEAST_HORIZON_S:g} s or more")
    return predictor_settings(predictor, weights, RATE_HZ, horizon)


def scores_of(
    *,
    built: "Predictor",
    name: str,
    data: Data,
    default: str,
    on_left_out: Callable[[str], None] = warn,
    tracked: bool = False,
) -> "list[Scores]":
    """The scores of the recordings; ``default`` is the data pack's split if none is asked for."""
    from hri_predict.calibration.scores import score_recordings

    found = files(data.entries, data.split, default)
    with progress() as bar:
        task = bar.add_task(f"forecasting, {name}", total=len(found))
        return score_recordings(
            built,
            found,
            on_recording=lambda _: bar.advance(task),
            on_left_out=on_left_out,
            joint_map=data.joint_map,
            tracked=tracked,
        )
