"""``calibrate``: make a calibration."""

import json
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from hri_predict.base.errors import ConfigError
from hri_predict.cli.calibrate.inputs import Data, scores_of, warn_of_simulated
from hri_predict.cli.common import check_writable, progress, stage, tell
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import PredictorSettings

if TYPE_CHECKING:
    from hri_predict.zones.calibration import Calibration


def make(
    *,
    settings: PredictorSettings,
    data: Data,
    tracked: bool,
    out: Path,
    as_json: bool,
) -> None:
    """Calibrate, write the file and say what it rests on."""
    from hri_predict.lab.calibration.conformal import calibrate as conformal
    from hri_predict.lab.calibration.levels import levels_text
    from hri_predict.lab.calibration.quantiles import LEAST_RECORDINGS
    from hri_predict.zones.calibration import identity
    from hri_predict.zones.motion_class import SPEED_CLASSES

    check_out(out)
    warn_of_simulated(data, "calibration")
    built = registry.load("predictors", settings.name)(settings)
    values, digest = identity(settings)
    with data.workers(settings, "calibration") as workers:
        scores = scores_of(
            settings=settings, data=data, default="calibration", tracked=tracked, workers=workers
        )
        with progress() as bar:
            task = bar.add_task("fitting the scale", total=None)
            fitted = conformal(
                scores=scores,
                predictor=settings.name,
                settings=values,
                weights=digest,
                rate_hz=built.rate_hz,
                skeleton=built.skeleton,
                on_fit=lambda what: stage(bar, task, what),
                workers=workers,
            )
    made = replace(fitted, made=date.today())
    write_calibration(out, made)
    if as_json:
        print(json.dumps({"file": str(out), **_made(made)}))
        return
    classes = range(len(SPEED_CLASSES))
    counts = [sum(r.windows[c] for r in made.recordings) for c in classes]
    units = [sum(r.windows[c] > 0 for r in made.recordings) for c in classes]
    console = Console()
    console.print(f"{len(made.recordings)} recordings, {sum(counts)} windows")
    for name, windows, recordings in zip(SPEED_CLASSES, counts, units, strict=True):
        few = (
            "" if recordings >= LEAST_RECORDINGS else "; too few, physical limits are used instead"
        )
        console.print(f"  {name}: {windows} windows of {recordings} recordings{few}")
    for line in levels_text(made):
        console.print(line, highlight=False)
    tell([out])


def check_out(out: Path) -> None:
    """Refuse, before the work, a file that cannot or should not be written."""
    check_writable(out.parent)
    if out.is_dir() or (out.exists() and out.suffix != ".json"):
        raise ConfigError(f"--out {out}: is not a calibration, so it stays; name a .json file")


def write_calibration(out: Path, made: "Calibration") -> None:
    """Write the file.

    Raises:
        ConfigError: it cannot be written.
    """
    from hri_predict.base.files import atomic_write
    from hri_predict.zones.calibration import save_text

    try:
        atomic_write(out, save_text(made).encode())
    except OSError as error:
        raise ConfigError(
            f"--out {out}: cannot be written: {error.strerror}; name another file"
        ) from error


def _made(made: "Calibration") -> dict[str, Any]:
    from hri_predict.lab.calibration.levels import levels_text

    return {
        "predictor": made.predictor,
        "recordings": [{"name": r.name, "windows": list(r.windows)} for r in made.recordings],
        "levels": levels_text(made),
    }
