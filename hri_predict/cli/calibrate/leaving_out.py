"""``calibrate --leave-out``: what zones hold of a set that the calibration never saw."""

import json
from pathlib import Path

from hri_predict.base.errors import ConfigError
from hri_predict.cli.calibrate.inputs import Data, scores_of
from hri_predict.cli.calibrate.making import write_calibration
from hri_predict.cli.common import check_writable, progress, show, stage, tell
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import PredictorSettings

_CALIBRATION, _JUDGED = "calibration", "test_motion"


def leave_out(*, settings: PredictorSettings, data: Data, out: Path | None, as_json: bool) -> None:
    """Leave each set of the data pack out of the calibration in turn, and measure on it.

    ``out`` gets the figures and each calibration, so that a closed loop can be run with it.
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
    if as_json:
        print(json.dumps(report))
        return
    show(judgement.tables(found, built.rate_hz), [])
