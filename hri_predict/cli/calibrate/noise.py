"""``calibrate --noise``: how much zones grow with a tracker's noise."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

from hri_predict.base.errors import ConfigError
from hri_predict.cli.calibrate.inputs import Data
from hri_predict.cli.calibrate.making import check_out, write_calibration
from hri_predict.cli.common import files, progress, tell
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import PredictorSettings

if TYPE_CHECKING:
    from hri_predict.lab.calibration.noise import See
    from hri_predict.lab.calibration.scores import Scores


def add_noise(
    *, settings: PredictorSettings, data: Data, path: Path | None, out: Path, as_json: bool
) -> None:
    """Measure the growth on noisy recordings, and write the calibration with it.

    ``path`` is the calibration, ``None``: the shipped one. All but the growth stays.

    Raises:
        ConfigError: there is no calibration, or no recording can be used.
    """
    from hri_predict.lab.calibration import noise
    from hri_predict.zones.calibration import calibration_for
    from hri_predict.zones.settings import LEVELS, CoverageSettings

    check_out(out)
    asked = CoverageSettings(calibration=None if path is None else str(path))
    calibration = calibration_for(settings, asked, Path())
    if calibration is None:
        raise ConfigError(
            f"--predictor {settings.name}: ships without a calibration; name one with --calibration"
        )
    built = registry.load("predictors", settings.name)(settings)
    recordings = files(data.entries, data.split, "calibration")
    trackers: list[See] = [noise.as_recorded, *(tracker.seen for tracker in noise.FITTED_TO)]
    scored: list[list[Scores]] = []
    with progress() as bar:
        task = bar.add_task("forecasting", total=len(trackers) * len(recordings))
        for seed, see in enumerate(trackers):
            scored.append(
                noise.scores_seen(
                    built,
                    recordings,
                    see,
                    seed=seed,
                    joint_map=data.joint_map,
                    on_recording=lambda _: bar.advance(task),
                )
            )
        if not scored[0]:
            raise ConfigError("--data: no person is seen for long enough; give other recordings")
        noisy = [entry for scores in scored[1:] for entry in scores]
        made = noise.with_noise(calibration, clean=scored[0], noisy=noisy, skeleton=built.skeleton)
    write_calibration(out, made)
    assert made.noise is not None
    growth = {
        of: {
            f"{level:g}": rows.round(3).tolist() for level, rows in zip(LEVELS, table, strict=True)
        }
        for of, table in made.noise.table.items()
    }
    if as_json:
        print(json.dumps({"file": str(out), "growth": growth}))
        return
    tell([out])
