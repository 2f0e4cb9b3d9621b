"""``calibrate``: make a calibration, cross-validate it by set, or add growth with noise."""

import json
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from hri_predict.base.errors import ConfigError
from hri_predict.cli.calibrate.inputs import (
    Data,
    demand_horizon,
    scores_of,
    warn_of_fitted,
    warn_of_simulated,
)
from hri_predict.cli.common import (
    check_writable,
    files,
    progress,
    result,
    stage,
    tell,
    warn,
    writing,
)
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Predictor, PredictorSettings

if TYPE_CHECKING:
    from hri_predict.lab.calibration.noise import See
    from hri_predict.lab.calibration.scores import Scores
    from hri_predict.zones.calibration import Calibration


def make(
    *,
    settings: PredictorSettings,
    data: Data,
    tracked: bool,
    out: Path,
    as_json: bool,
) -> None:
    """Calibrate, write the file and print the recordings and windows used."""
    from hri_predict.lab.calibration.conformal import calibrate as conformal
    from hri_predict.lab.calibration.levels import levels_text
    from hri_predict.lab.calibration.quantiles import LEAST_RECORDINGS
    from hri_predict.zones.motion_class import SPEED_CLASSES
    from hri_predict.zones.predictor_identity import identity

    check_out(out)
    warn_of_simulated(data, "calibration")
    warn_of_fitted(settings, data, "calibration")
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
    made = replace(fitted, made=date.today(), code=registry.code_of(settings))
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
    """Before the work starts, reject a file that cannot or should not be written."""
    check_writable(out.parent)
    if out.exists() and not _is_calibration(out):
        raise ConfigError(
            f"--out {out}: exists and is not a calibration, so it is not replaced; name a .json "
            f"file"
        )


def _is_calibration(path: Path) -> bool:
    """Whether a file holds a calibration, perhaps one of another version."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(data, dict) and {"version", "predictor"} <= data.keys()


def write_calibration(out: Path, made: "Calibration") -> None:
    """Write the file.

    Raises:
        ConfigError: it cannot be written.
    """
    from hri_predict.base.files import atomic_write
    from hri_predict.zones.calibration import save_text

    with writing(f"--out {out}", "name another file"):
        atomic_write(out, save_text(made).encode())


def _made(made: "Calibration") -> dict[str, Any]:
    from hri_predict.lab.calibration.levels import levels_text

    return {
        "predictor": made.predictor,
        "recordings": [{"name": r.name, "windows": list(r.windows)} for r in made.recordings],
        "levels": levels_text(made),
    }


# -- calibrate --leave-out: what zones hold of a set that the calibration never saw ----------------

_CALIBRATION, _JUDGED = "calibration", "test_motion"


def leave_out(*, settings: PredictorSettings, data: Data, out: Path | None, as_json: bool) -> None:
    """Leave each set of the data pack out of the calibration in turn, and measure on it.

    ``out`` receives the figures and each calibration, for runs in a closed loop.
    """
    from hri_predict.base.files import atomic_write
    from hri_predict.lab.calibration import leaving_out as judgement

    if data.split is not None:
        raise ConfigError(
            f"--split {data.split}: has no effect with --leave-out, which calibrates on the split "
            f"{_CALIBRATION} and measures on it and {_JUDGED}; leave it out"
        )
    if out is not None:
        check_writable(out)
    built = registry.load("predictors", settings.name)(settings)
    to_calibrate = data._replace(split=_CALIBRATION)
    warn_of_fitted(settings, to_calibrate, "")
    known = scores_of(settings=settings, data=to_calibrate, default="", tracked=True)
    judged = [
        entry
        for split in (_CALIBRATION, _JUDGED)
        for entry in scores_of(settings=settings, data=data._replace(split=split), default="")
    ]
    with data.workers(settings, _CALIBRATION) as workers, progress() as bar:
        task = bar.add_task("calibrating without", total=None)
        found = judgement.leave_out(
            predictor=built,
            settings=settings,
            scores=known,
            judged=judged,
            workers=workers,
            on_part=lambda p: stage(bar, task, f"calibrating without {p}"),
        )
    report = {"predictor": settings.name, "sets": judgement.as_json(found)}
    if out is not None:
        written = [out / "leave_out.json"]
        atomic_write(written[0], (json.dumps(report, indent=1) + "\n").encode())
        for left in found:
            written.append(out / f"without_{left.name}.calibration.json")
            write_calibration(written[-1], left.calibration)
        tell(written)
    result(as_json, report, judgement.tables(found, built.rate_hz))


# -- calibrate --noise: how much zones grow with a tracker's noise ---------------------------------


def add_noise(
    *, settings: PredictorSettings, data: Data, path: Path | None, out: Path, as_json: bool
) -> None:
    """Measure the growth on noisy recordings, and write it into the calibration.

    ``path`` is the calibration (``None``: the shipped one). Everything except the growth stays the
    same.

    Raises:
        ConfigError: the calibration is missing or has another horizon, or too few of the
            recordings are usable.
    """
    from hri_predict.lab.calibration import noise
    from hri_predict.zones.calibration import calibration_for, shipped_calibration
    from hri_predict.zones.settings import LEVELS, CoverageSettings

    check_out(out)
    asked = CoverageSettings(calibration=None if path is None else str(path))
    calibration = calibration_for(settings, asked, Path())
    if calibration is None:
        raise ConfigError(
            f"--predictor {settings.name}: ships without a calibration; name one with --calibration"
        )
    built = registry.load("predictors", settings.name)(settings)
    demand_horizon(built, settings, calibration, path or shipped_calibration(settings.name))
    clean, noisy = _seen(built, data)
    made = noise.with_noise(calibration, clean=clean, noisy=noisy, skeleton=built.skeleton)
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


def _seen(predictor: Predictor, data: Data) -> "tuple[list[Scores], list[Scores]]":
    """Return the scores of the recordings as recorded, and as noisy trackers see them."""
    from hri_predict.lab.calibration import noise

    recordings = files(data.entries, data.split, "calibration")
    trackers: list[See] = [noise.as_recorded, *(tracker.seen for tracker in noise.FITTED_TO)]
    scored: list[list[Scores]] = []
    named: set[str] = set()

    def left_out(line: str) -> None:  # comes once per tracker
        if line not in named:
            named.add(line)
            warn(line)

    with progress() as bar:
        task = bar.add_task("forecasting", total=len(trackers) * len(recordings))
        for seed, see in enumerate(trackers):
            scored.append(
                noise.scores_seen(
                    predictor,
                    recordings,
                    see,
                    seed=seed,
                    joint_map=data.joint_map,
                    on_recording=lambda _: bar.advance(task),
                    on_left_out=left_out,
                )
            )
    return scored[0], [entry for scores in scored[1:] for entry in scores]
