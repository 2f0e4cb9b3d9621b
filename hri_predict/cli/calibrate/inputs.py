"""Inputs common to all forms of ``calibrate``: predictor, recordings, scores."""

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import yaml

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.files import load_yaml
from hri_predict.cli.common import files, predictor_settings, progress, warn
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.predictor import Predictor, PredictorSettings
from hri_predict.recording import recording_info
from hri_predict.zones.predictor_identity import CALIBRATED_S

if TYPE_CHECKING:
    from hri_predict.base.work.workers import Workers
    from hri_predict.lab.calibration.scores import Scores
    from hri_predict.zones.calibration import Calibration

RATE_HZ = 25.0
HORIZON_S = CALIBRATED_S
SIMULATED = ("approach", "procedural")
"""Kinds of sources that simulate people."""
LEAST_HORIZON_S = 0.2
"""Minimum horizon in seconds: before it, no robot can stop."""


class Data(NamedTuple):
    """The recordings, their joint map and the workers."""

    entries: Sequence[Path]
    split: str | None
    joint_map: JointMap | None
    jobs: int = 1
    cluster: str | None = None

    def workers(self, settings: PredictorSettings, default: str = "") -> "Workers":
        """Return the workers that score and fit.

        Raises:
            ConfigError: the cluster cannot be used.
        """
        from hri_predict.base.work.workers_for import workers_for

        weights = getattr(settings, "weights", None)
        reads = [] if weights is None else [Path(weights)]
        if self.cluster is not None:
            reads += [path.resolve() for path in files(self.entries, self.split, default)]
        return workers_for(self.jobs, self.cluster, reads)


def calibrated_settings(predictor: str, weights: Path | None, horizon: float) -> PredictorSettings:
    """Return a predictor's settings at the calibration rate.

    Raises:
        ConfigError: the horizon is too short, or the predictor cannot reach it.
    """
    if not horizon >= LEAST_HORIZON_S:
        raise ConfigError(f"--horizon {horizon:g}: too short; give {LEAST_HORIZON_S:g} s or more")
    return predictor_settings(predictor, weights, RATE_HZ, horizon)


def demand_horizon(
    predictor: Predictor, settings: PredictorSettings, calibration: "Calibration", path: Path
) -> None:
    """Check that the predictor forecasts as many steps as the calibration at ``path`` has.

    Raises:
        ConfigError: it does not.
    """
    if predictor.horizon_steps != calibration.steps:
        reach_s = calibration.steps / calibration.rate_hz
        raise ConfigError(
            f"--horizon {settings.horizon_s:g}: the calibration {path} reaches {reach_s:g} s; "
            f"give --horizon {reach_s:g}"
        )


def warn_of_simulated(data: Data, default: str) -> None:
    """Warn once if recordings of the node state that people were simulated; others never do."""
    found = [path for path in files(data.entries, data.split, default) if _is_simulated(path)]
    if found:
        more = f" and {len(found) - 1} more" if len(found) > 1 else ""
        warn(
            f"{found[0]}{more}: its people were simulated; zones calibrated on simulated motion "
            f"are not valid for real people"
        )


def warn_of_fitted(settings: PredictorSettings, data: Data, default: str) -> None:
    """Warn once if the predictor's weights were fitted on any of the recordings."""
    weights = [path for path in settings.files() if path.suffix == ".safetensors"]
    if not weights:
        return
    from hri_predict.lab.calibration.fitted_on import fitted_on  # with torch: takes seconds

    given = files(data.entries, data.split, default)
    if found := fitted_on(weights, given):
        names = ", ".join(path.name for path in found[:3]) + (", ..." if found[3:] else "")
        warn(
            f"the weights of {settings.name} were fitted on {len(found)} of these {len(given)} "
            f"recordings ({names}): errors on them are smaller than on others, and so would be the "
            f"zones; give recordings that the predictor was not trained on"
        )


def _is_simulated(path: Path) -> bool:
    """Whether the configuration stored in a recording has a source of simulated people."""
    if path.suffix.lower() != ".mcap":
        return False
    try:
        config = load_yaml(recording_info(path).config)
        return config["source"]["kind"] in SIMULATED
    except (OSError, RecordingError, yaml.YAMLError, KeyError, TypeError, RecursionError):
        return False  # whoever reads the motion tells what is wrong with the file


def scores_of(
    *,
    settings: PredictorSettings,
    data: Data,
    default: str,
    on_left_out: Callable[[str], None] = warn,
    tracked: bool = False,
    workers: "Workers | None" = None,
) -> "list[Scores]":
    """Return the recordings' scores; ``default`` is the split of a data pack if none is given.

    ``workers`` do the scoring; default: those of ``data``, used only for this call.
    """
    from hri_predict.lab.calibration.scores import scores_by

    with contextlib.ExitStack() as leaving:
        if workers is None:
            workers = leaving.enter_context(data.workers(settings, default))
        found = files(data.entries, data.split, default)
        if data.cluster is not None:  # a worker has another current folder
            found = [path.resolve() for path in found]
        bar = leaving.enter_context(progress())
        task = bar.add_task(f"forecasting, {settings.name}", total=len(found))
        return scores_by(
            workers,
            settings,
            found,
            on_recording=lambda: bar.advance(task),
            on_left_out=on_left_out,
            joint_map=data.joint_map,
            tracked=tracked,
        )
