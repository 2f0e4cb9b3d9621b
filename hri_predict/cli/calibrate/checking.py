"""``calibrate --check``: measure the coverage of zones, and their size."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hri_predict.base.errors import ConfigError
from hri_predict.base.looks import can_plot
from hri_predict.cli.calibrate.inputs import (
    HORIZON_S,
    Data,
    calibrated_settings,
    scores_of,
    warn_of_fitted,
)
from hri_predict.cli.common import (
    check_out,
    command,
    progress,
    result,
    tell,
    writing,
)
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import PredictorSettings

if TYPE_CHECKING:
    from hri_predict.lab.calibration.coverage import Calibrated
    from hri_predict.lab.calibration.scores import Scores
    from hri_predict.zones.calibration import Calibration

_BESIDE = "constant_velocity"


def check(
    *,
    settings: PredictorSettings,
    data: Data,
    path: Path | None,
    tracked: bool,
    out: Path | None,
    card: Path | None,
    disturb: bool,
    as_json: bool,
) -> None:
    """Measure a calibration and print tables."""
    from hri_predict.lab.calibration import judgement
    from hri_predict.lab.calibration.card import read_card, write_section
    from hri_predict.lab.calibration.coverage import Calibrated

    if out is not None:
        check_out(out)
    if card is not None:
        read_card(card)  # before minutes of work
    built = registry.load("predictors", settings.name)(settings)
    calibration = _calibration(settings, path)
    warn_of_fitted(settings, data, "test")
    scores = scores_of(settings=settings, data=data, default="test", tracked=tracked)
    used = _calibrated_on(calibration, scores)
    if used:
        print(
            f"warning: the calibration was made from {len(used)} of these recordings"
            f" ({', '.join(sorted(used)[:3])}, ...): their coverage does not apply to other "
            f"recordings",
            file=sys.stderr,
        )
    beside = _beside(settings.name, data, tracked)
    with progress() as bar:
        task = bar.add_task("judging", total=None)
        judged = judgement.judge_zones(
            Calibrated(built, calibration),
            scores,
            beside,
            lambda p: bar.update(task, description=p),
        )
    tables = judgement.tables(judged)
    report = {**judgement.as_json(judged), "disturbed": None}
    if disturb:
        from hri_predict.lab.calibration import disturbed as zone_disturbed

        with progress() as bar:
            task = bar.add_task("disturbing", total=None)
            found = zone_disturbed.judge_disturbed(
                Calibrated(built, calibration),
                scores,
                lambda p: bar.update(task, description=p),
            )
        tables += zone_disturbed.tables(found)
        report["disturbed"] = zone_disturbed.as_json(found)
    if out is not None:
        from hri_predict.base.files import atomic_write

        page, numbers = out / "zones.md", out / "zones.json"
        with writing(f"--out {out}", "name another folder"):
            atomic_write(page, judgement.markdown(judged, tables, command()).encode())
            atomic_write(numbers, (json.dumps(report, indent=1) + "\n").encode())
            written = [page, numbers]
            if can_plot():
                from hri_predict.lab.calibration.plots import write_pictures

                written += write_pictures(
                    out=out, predictor=built, scores=scores, judged=judged, beside=beside
                )
        tell(written)
    if card is not None:
        write_section(card, judged)
        tell([card])
    result(as_json, report, tables, judgement.notes(judged))


def _calibrated_on(calibration: "Calibration", scores: "Sequence[Scores]") -> set[str]:
    """Return the names of the recordings that the calibration was made from, by content.

    Recordings without a digest are compared by name.
    """
    from hri_predict.lab.calibration.scores import units

    digests = {used.digest for used in calibration.used if used.digest}
    names = {used.name for used in calibration.used if not used.digest}
    found = set()
    for name, own in units(scores).items():
        if scores[own[0]].digest in digests or {name, Path(name).stem} & names:
            found.add(name)
    return found


def _calibration(settings: PredictorSettings, path: Path | None) -> "Calibration":
    from hri_predict.zones.calibration import calibration_for
    from hri_predict.zones.predictor_identity import calibrate_command
    from hri_predict.zones.settings import CoverageSettings

    asked = CoverageSettings(calibration=None if path is None else str(path))
    found = calibration_for(settings, asked, Path())
    if found is None:
        weights = getattr(settings, "weights", None)
        make = calibrate_command(settings.name, weights, settings.horizon_s)
        raise ConfigError(
            f"--predictor {settings.name}: no calibration is shipped for these settings; make one: "
            f"{make}, and give it with --calibration"
        )
    return found


def _beside(
    name: str, data: Data, tracked: bool
) -> "Mapping[str, tuple[list[Scores], Calibrated]]":
    """Return constant velocity, calibrated in the same way, for comparison of sizes."""
    from hri_predict.lab.calibration.coverage import Calibrated
    from hri_predict.zones.calibration import load_calibration, shipped_calibration

    path = shipped_calibration(_BESIDE)
    if name == _BESIDE or not path.is_file():
        return {}
    settings = calibrated_settings(_BESIDE, None, HORIZON_S)
    built = registry.load("predictors", _BESIDE)(settings)
    return {
        _BESIDE: (
            scores_of(
                settings=settings,
                data=data,
                default="test",
                on_left_out=lambda _: None,  # said once
                tracked=tracked,
            ),
            Calibrated(built, load_calibration(path)),
        )
    }
