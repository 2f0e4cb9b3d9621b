"""``calibrate``: how large zones must be to hold people as often as stated; whether they do."""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from hri_predict import registry
from hri_predict.cli.common import (
    check_writable,
    command,
    files,
    need_plots,
    one_of,
    predictor_settings,
    progress,
    show,
    tell,
    warn,
    without_effect,
)
from hri_predict.datasets.splits import USES
from hri_predict.errors import ConfigError
from hri_predict.predictors.base import PredictorSettings

if TYPE_CHECKING:
    from hri_predict.calibration.scores import Scores
    from hri_predict.predictors.base import Predictor
    from hri_predict.risk.zones.radii import Calibration

RATE_HZ = 25.0
HORIZON_S = 1.2
LEAST_HORIZON_S = 0.2
"""Shorter zones protect nobody: robots take longer to stop."""
_BESIDE = "constant_velocity"


def calibrate(
    *,
    predictor: Annotated[
        str, typer.Option(help="Name of the predictor; hri-predict predictors lists them.")
    ],
    data: Annotated[list[Path], typer.Option(help="A recording, or a folder of them. Repeatable.")],
    weights: Annotated[Path | None, typer.Option(help="Weights of a trained predictor.")] = None,
    horizon: Annotated[
        float, typer.Option(help="Seconds ahead, at most as far as the predictor reaches.")
    ] = HORIZON_S,
    check: Annotated[
        bool, typer.Option("--check", help="Measure a calibration instead of making one.")
    ] = False,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="With --check: the calibration to measure.", show_default="the shipped one"
        ),
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(
            help="Split of the data pack.", show_default="calibration; with --check: test"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="File for the calibration; with --check: folder for tables and pictures.",
            show_default="PREDICTOR.calibration.json",
        ),
    ] = None,
    card: Annotated[
        Path | None,
        typer.Option(help="With --check: Markdown card; its section about zones is replaced."),
    ] = None,
    disturb: Annotated[
        bool,
        typer.Option(
            "--disturb", help="With --check: also with noise, a wrong scale and a moved camera."
        ),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON.")] = False,
) -> None:
    """Calibrate a predictor's zones on recordings; --check measures how often zones hold people.

    The number of recordings counts, not their length: a guarantee of 90 %
    needs 9, one of 95 % needs 19, and one of 99 % needs 99.

    Example: hri-predict calibrate --predictor sinn --data ../shared/data
    """
    settings = _settings(predictor, weights, horizon)
    if split is not None:
        one_of("--split", split, USES)
    if check:
        _check(
            settings=settings,
            data=data,
            path=calibration,
            split=split,
            out=out,
            card=card,
            disturb=disturb,
            as_json=as_json,
        )
        return
    without_effect(
        {"--calibration": calibration, "--disturb": True if disturb else None, "--card": card},
        "without --check",
    )
    _make(
        settings=settings,
        data=data,
        split=split,
        out=out or Path(f"{predictor}.calibration.json"),
        as_json=as_json,
    )


def _settings(predictor: str, weights: Path | None, horizon: float) -> PredictorSettings:
    if not horizon >= LEAST_HORIZON_S:
        raise ConfigError(f"--horizon {horizon:g}: too short; give {LEAST_HORIZON_S:g} s or more")
    return predictor_settings(predictor, weights, RATE_HZ, horizon)


def _make(
    *,
    settings: PredictorSettings,
    data: Sequence[Path],
    split: str | None,
    out: Path,
    as_json: bool,
) -> None:
    from hri_predict.calibration.conformal import LEAST_RECORDINGS
    from hri_predict.calibration.conformal import calibrate as conformal
    from hri_predict.files import atomic_write
    from hri_predict.risk.zones.motion_class import CLASSES
    from hri_predict.risk.zones.radii import identity, levels_text, save_text

    check_writable(out.parent)
    if out.is_dir() or (out.exists() and out.suffix != ".json"):
        raise ConfigError(f"--out {out}: is not a calibration, so it stays; name a .json file")
    built = registry.load("predictors", settings.name)(settings)
    scores = _scores(built=built, name=settings.name, data=data, split=split, default="calibration")
    values, digest = identity(settings)
    made = conformal(
        scores=scores,
        predictor=settings.name,
        settings=values,
        weights=digest,
        rate_hz=built.rate_hz,
        skeleton=built.skeleton,
    )
    try:
        atomic_write(out, save_text(made).encode())
    except OSError as error:
        raise ConfigError(
            f"--out {out}: cannot be written: {error.strerror}; name another file"
        ) from error
    if as_json:
        print(json.dumps({"file": str(out), **_made(made)}))
        return
    counts = [sum(r.windows[c] for r in made.recordings) for c in range(len(CLASSES))]
    units = [sum(r.windows[c] > 0 for r in made.recordings) for c in range(len(CLASSES))]
    console = Console()
    console.print(f"{len(made.recordings)} recordings, {sum(counts)} windows")
    for name, windows, recordings in zip(CLASSES, counts, units, strict=True):
        few = (
            "" if recordings >= LEAST_RECORDINGS else "; too few, physical limits are used instead"
        )
        console.print(f"  {name}: {windows} windows of {recordings} recordings{few}")
    for line in levels_text(made):
        console.print(line, highlight=False)
    tell([out])


def _made(made: "Calibration") -> dict[str, Any]:
    from hri_predict.risk.zones.radii import levels_text

    return {
        "predictor": made.predictor,
        "recordings": [{"name": r.name, "windows": list(r.windows)} for r in made.recordings],
        "levels": levels_text(made),
    }


def _scores(
    *,
    built: "Predictor",
    name: str,
    data: Sequence[Path],
    split: str | None,
    default: str,
    on_left_out: Callable[[str], None] = warn,
) -> "list[Scores]":
    from hri_predict.calibration.scores import score_recordings

    found = files(data, split, default)
    with progress() as bar:
        task = bar.add_task(f"forecasting, {name}", total=len(found))
        return score_recordings(built, found, lambda _: bar.advance(task), on_left_out)


def _check(
    *,
    settings: PredictorSettings,
    data: Sequence[Path],
    path: Path | None,
    split: str | None,
    out: Path | None,
    card: Path | None,
    disturb: bool,
    as_json: bool,
) -> None:
    from hri_predict.calibration import judgement

    if out is not None:
        need_plots()
        check_writable(out)
    built = registry.load("predictors", settings.name)(settings)
    calibration = _calibration(settings, path)
    scores = _scores(built=built, name=settings.name, data=data, split=split, default="test")
    used = _calibrated_on(calibration, scores)
    if used:
        print(
            f"warning: the calibration was made from {len(used)} of these recordings"
            f" ({', '.join(sorted(used)[:3])}, ...): their coverage says nothing about others",
            file=sys.stderr,
        )
    beside = _beside(settings.name, data, split)
    with progress() as bar:
        task = bar.add_task("judging", total=None)
        judged = judgement.judge_zones(
            predictor=built,
            scores=scores,
            calibration=calibration,
            beside=beside,
            on_part=lambda p: bar.update(task, description=p),
        )
    tables = judgement.tables(judged)
    report = {**judgement.as_json(judged), "disturbed": None}
    if disturb:
        from hri_predict.calibration import disturbed as zone_disturbed

        with progress() as bar:
            task = bar.add_task("disturbing", total=None)
            found = zone_disturbed.judge_disturbed(
                built, scores, calibration, lambda p: bar.update(task, description=p)
            )
        tables += zone_disturbed.tables(found)
        report["disturbed"] = zone_disturbed.as_json(found)
    if out is not None:
        text = judgement.markdown(judged, tables, command())
        tell(
            _written(
                out=out,
                text=text,
                report=report,
                built=built,
                scores=scores,
                judged=judged,
                beside=beside,
            )
        )
    if card is not None:
        from hri_predict.calibration.card import write_section

        write_section(card, judged)
        tell([card])
    if as_json:
        print(json.dumps(report))
        return
    show(tables, judgement.notes(judged))


def _calibrated_on(calibration: "Calibration", scores: "Sequence[Scores]") -> set[str]:
    """Names of the recordings that the calibration was made from: the same file by any name.

    For a calibration without digests: a recording of the same name with as many windows.
    """
    from hri_predict.calibration.scores import units

    digests = {used.digest for used in calibration.recordings if used.digest}
    counted = {(u.name, sum(u.windows)) for u in calibration.recordings if not u.digest}
    found = set()
    for name, own in units(scores).items():
        windows = sum(len(scores[i].origin_ns) for i in own)
        like = {(name, windows), (Path(name).stem, windows)}
        if scores[own[0]].digest in digests or like & counted:
            found.add(name)
    return found


def _calibration(settings: PredictorSettings, path: Path | None) -> "Calibration":
    from hri_predict.risk.settings import CoverageSettings
    from hri_predict.risk.zones.radii import calibration_for

    asked = CoverageSettings(calibration=None if path is None else str(path))
    found = calibration_for(settings, asked, Path())
    if found is None:
        raise ConfigError(
            f"--predictor {settings.name}: no calibration is shipped for these settings; make one:"
            f" hri-predict calibrate --predictor {settings.name} --data DIR, and give it with"
            f" --calibration"
        )
    return found


def _beside(
    name: str, data: Sequence[Path], split: str | None
) -> "Mapping[str, tuple[list[Scores], Calibration, Predictor]]":
    """Constant velocity, calibrated the same way, to compare sizes with."""
    from hri_predict.risk.zones.radii import load_calibration, shipped_calibration

    path = shipped_calibration(_BESIDE)
    if name == _BESIDE or not path.is_file():
        return {}
    settings = _settings(_BESIDE, None, HORIZON_S)
    built = registry.load("predictors", _BESIDE)(settings)
    return {
        _BESIDE: (
            _scores(
                built=built,
                name=_BESIDE,
                data=data,
                split=split,
                default="test",
                on_left_out=lambda _: None,  # said once
            ),
            load_calibration(path),
            built,
        )
    }


def _written(
    *,
    out: Path,
    text: str,
    report: dict[str, Any],
    built: "Predictor",
    scores: "Sequence[Scores]",
    judged: Any,
    beside: Any,
) -> list[Path]:
    from hri_predict.calibration.plots import write_pictures
    from hri_predict.files import atomic_write

    try:
        atomic_write(out / "zones.md", text.encode())
        atomic_write(out / "zones.json", (json.dumps(report, indent=1) + "\n").encode())
        pictures = write_pictures(
            out=out, predictor=built, scores=scores, judged=judged, beside=beside
        )
    except OSError as error:
        raise ConfigError(
            f"--out {out}: cannot be written: {error.strerror}; name another folder"
        ) from error
    return [out / "zones.md", out / "zones.json", *pictures]
