"""``evaluate``: measure a predictor, by the papers' benchmark or on real recordings.

``card``: ship trained weights with a card of the results of ``evaluate``.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hri_predict.base.errors import ConfigError, UnusableRecordingError
from hri_predict.base.looks import can_plot
from hri_predict.base.set_key import set_key
from hri_predict.cli.common import (
    CalibrationsOption,
    ClusterOption,
    JobsOption,
    JointMapOption,
    JsonOption,
    check_out,
    files,
    one_of,
    own_map,
    predictor_settings,
    processes,
    progress,
    result,
    tell,
    warn,
    without_effect,
)
from hri_predict.cli.evaluate_benchmark import by_benchmark
from hri_predict.lab.datasets.splits import USES

if TYPE_CHECKING:  # torch takes seconds to import, which the other commands need not wait for
    from hri_predict.contracts.joint_map import JointMap
    from hri_predict.contracts.predictor import PredictorSettings
    from hri_predict.lab.evaluation.windows import Motion
    from hri_predict.run.compared_predictors import ComparedPredictor
    from hri_predict.run.zone_basis import ZoneBasis


_SET_ELSEWHERE = {
    "name": "give the --predictor that you mean",
    "weights": "give --predictor NAME=WEIGHTS instead",
    "horizon_s": "give --horizon instead",
    "rate_hz": "all are evaluated at the same rate; leave it out",
}


def evaluate(
    *,
    data: Annotated[
        list[Path], typer.Option(help="Folder of the data pack, or recordings. Repeatable.")
    ],
    predictor: Annotated[
        list[str],
        typer.Option(
            metavar="NAME[=WEIGHTS]",
            help="Predictor, alone or with your own weights (mixer=best.safetensors). Repeatable.",
        ),
    ],
    weights: Annotated[
        list[Path] | None,
        typer.Option(help="Weights, *.safetensors; one for each --predictor, in the same order."),
    ] = None,
    calibration: CalibrationsOption = None,
    benchmark: Annotated[
        str | None,
        typer.Option(help="cmu, human36m, or a package's: evaluate as the papers do."),
    ] = None,
    windows: Annotated[
        str | None,
        typer.Option(
            help="Benchmark: all, 8-seeds or 80-seeds of each test recording.", show_default="all"
        ),
    ] = None,
    n_out: Annotated[
        int | None, typer.Option(help="Benchmark: frames predicted, 10 or 25.", show_default="25")
    ] = None,
    n_in: Annotated[
        int | None,
        typer.Option(
            help="Benchmark: frames observed, 2 to 50; SINN's paper uses 25.",
            show_default="10, with euler 50",
        ),
    ] = None,
    error: Annotated[
        str | None,
        typer.Option(
            help="Benchmark: mpjpe, or euler (KD-Former's own).",
            show_default="what the weights were trained for",
        ),
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(
            help="Split of the data pack: validation, test, test_motion, ...", show_default="test"
        ),
    ] = None,
    horizon: Annotated[
        float | None,
        typer.Option(
            help="Horizon, seconds: 1, 1.6 or 2; longer leaves fewer windows.", show_default="1"
        ),
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME.KEY=VALUE",
            help="A setting of a --predictor, such as aggregated.inner=sinn. Repeatable.",
        ),
    ] = None,
    joint_map: JointMapOption = None,
    disturb: Annotated[
        bool,
        typer.Option(
            "--disturb", help="Also evaluate with missing joints, noise and dropped frames."
        ),
    ] = False,
    jobs: JobsOption = None,
    cluster: ClusterOption = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for tables (Markdown, CSV, JSON) and plots.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Evaluate predictors on recordings or, with --benchmark, as the papers do.

    Errors on recordings are in true seconds and metres. Baselines are always included.

    Example: hri-predict evaluate --data ../shared/data --predictor sinn --predictor trajectorycnn
    """
    asked = _paired(predictor, weights or [])
    if out is not None:
        check_out(out)
    if benchmark is None:
        without_effect(
            {"--windows": windows, "--n-out": n_out, "--n-in": n_in, "--error": error},
            "without --benchmark",
        )
        if split is not None:
            one_of("--split", split, USES)
        _real(
            data=data,
            asked=asked,
            split=split,
            future_steps=_steps(1.0 if horizon is None else horizon),
            changes=changes or (),
            joint_map=joint_map,
            disturb=disturb,
            calibrations=calibration or (),
            jobs=processes(jobs, cluster),
            cluster=cluster,
            out=out,
            as_json=as_json,
        )
    else:
        without_effect(
            {
                "--split": split,
                "--horizon": horizon,
                "--set": changes,
                "--joint-map": joint_map,
                "--calibration": calibration,
                "--disturb": True if disturb else None,
                "--jobs": jobs,
                "--cluster": cluster,
            },
            "with --benchmark",
        )
        by_benchmark(
            data=data,
            asked=asked,
            options=(
                benchmark,
                "all" if windows is None else windows,
                25 if n_out is None else n_out,
                n_in,
                error,
            ),
            out=out,
            as_json=as_json,
        )


def _steps(horizon_s: float) -> int:
    """Return the number of steps of ``--horizon``, at which tables and pictures end."""
    from hri_predict.lab.evaluation.windows import FUTURE_STEPS, HORIZON_STEPS, RATE_HZ

    known = {step / RATE_HZ: step for step in HORIZON_STEPS if step >= FUTURE_STEPS}
    if horizon_s not in known:
        told = ", ".join(f"{each:g}" for each in known)
        raise ConfigError(f"--horizon {horizon_s:g}: is evaluated to {told} s; give one of them")
    return known[horizon_s]


def _paired(predictors: Sequence[str], weights: Sequence[Path]) -> "dict[str, ComparedPredictor]":
    """Return the predictor and weights of each label."""
    from hri_predict.run.compared_predictors import asked_predictors

    if not weights:
        return {asked.label: asked for asked in asked_predictors(predictors)}
    for text in predictors:
        if "=" in text:
            raise ConfigError(
                f"--predictor {text}: names its weights, and so does --weights; leave --weights out"
            )
    if len(weights) != len(predictors):
        raise ConfigError(
            f"--weights: {len(weights)} given for {len(predictors)} --predictor; give one for each "
            f"in the same order, or write --predictor NAME=WEIGHTS where a predictor has weights "
            f"(baselines have none, and are always evaluated)"
        )
    pairs = [f"{name}={file}" for name, file in zip(predictors, weights, strict=True)]
    return {asked.label: asked for asked in asked_predictors(pairs)}


def _real(
    *,
    data: list[Path],
    asked: "Mapping[str, ComparedPredictor]",
    split: str | None,
    future_steps: int,
    changes: Sequence[str],
    joint_map: str | None,
    disturb: bool,
    calibrations: Sequence[Path],
    jobs: int,
    cluster: str | None,
    out: Path | None,
    as_json: bool,
) -> None:
    from hri_predict.base.work.workers_for import workers_for
    from hri_predict.lab.datasets.corruption import standard
    from hri_predict.lab.evaluation import report
    from hri_predict.lab.evaluation.recordings import baselines, built, judge_by

    own = _settings(asked, future_steps, changes)
    predictors = {name: built(settings) for name, settings in own.items()}  # errors before the work
    bases = _bases(asked, own, calibrations)
    motions = _motions(files(data, split), own_map(joint_map))
    conditions = (None, *(standard() if disturb else ()))
    weighed = [each.weights for each in asked.values() if each.weights is not None]
    with workers_for(jobs, cluster, weighed) as workers, progress() as bar:
        task = bar.add_task("judging", total=len(motions) * len(conditions))
        results = []
        for condition in conditions:
            text = "judging" if condition is None else condition.name
            bar.update(task, description=text)
            results += judge_by(
                workers,
                own | baselines(future_steps) | own,  # a baseline's own settings, if it has any
                motions,
                condition,
                future_steps=future_steps,
                on_motion=lambda: bar.advance(task),
            )
    if out is not None:
        written = report.write_report(results, out, bases)
        if can_plot():
            from hri_predict.lab.evaluation.filmstrip import write_filmstrips

            written += write_filmstrips(predictors, motions, out, results[0].averaged)
        tell(written)
    tables = [report.judge_table(results), *report.action_tables(results)]
    if disturb:
        tables.append(report.corruption_table(results))
    result(as_json, report.as_json(results, bases), tables, [basis.line for basis in bases])


def _bases(
    asked: "Mapping[str, ComparedPredictor]",
    settings: "Mapping[str, PredictorSettings]",
    calibrations: Sequence[Path],
) -> "list[ZoneBasis]":
    """Return the basis of each predictor's zones, which forecast errors alone do not show."""
    from hri_predict.run.compared_predictors import basis_of, demand_use, fitting
    from hri_predict.zones.settings import CoverageSettings

    demand_use(calibrations, settings)
    bases = []
    for label, each in asked.items():
        found = fitting(calibrations, settings[label])
        coverage = CoverageSettings(calibration=None if found is None else str(found))
        bases.append(basis_of(each, settings[label], coverage, Path()))
    return bases


def _motions(paths: Sequence[Path], joint_map: "JointMap | None") -> "list[Motion]":
    """Return the motions of all recordings; unusable ones are reported and left out."""
    from hri_predict.lab.evaluation.table import HORIZONS_MS
    from hri_predict.lab.evaluation.windows import origins, read_motions

    found, left_out = [], []
    for path in paths:
        try:
            motions = read_motions([path], joint_map)
        except UnusableRecordingError as error:
            left_out.append(str(error))
            continue
        own = [motion for motion in motions if len(origins(motion)[0])]
        found += own
        if not own:
            left_out.append(
                f"recording {path}: no person is seen long enough for {HORIZONS_MS[0]} ms"
            )
    if not found:
        raise ConfigError(f"--data: no recording can be evaluated: {left_out[0]}; give others")
    for why in left_out:
        warn(f"{why}; left out")
    return found


def _settings(
    asked: "Mapping[str, ComparedPredictor]", future_steps: int, changes: Sequence[str]
) -> "dict[str, PredictorSettings]":
    """Return the settings of each label, with the changes from ``--set``."""
    from hri_predict.lab.evaluation.windows import RATE_HZ

    own: dict[str, Any] = {each.name: {} for each in asked.values()}
    for change in changes:
        path, _, _ = change.partition("=")
        name, _, key = path.strip().partition(".")
        if name not in own or not key or "=" not in change:
            raise ConfigError(
                f"--set {change}: write it as NAME.key=value, with NAME of a --predictor"
            )
        if key in _SET_ELSEWHERE:
            raise ConfigError(f"--set {change}: {_SET_ELSEWHERE[key]}")
        set_key(own, change)
    return {
        label: predictor_settings(
            each.name, each.weights, RATE_HZ, future_steps / RATE_HZ, changes=own[each.name]
        )
        for label, each in asked.items()
    }


def card(
    *,
    weights: Annotated[Path, typer.Argument(help="Weights of a finished run.")],
    real: Annotated[Path | None, typer.Option(help="real.json for these weights.")] = None,
    benchmark: Annotated[
        Path | None, typer.Option(help="The benchmark's JSON for the same method.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for both files.", show_default="where the node finds them"),
    ] = None,
) -> None:
    """Ship a run's weights with a card: shape, latency, data, configuration and results.

    Example: hri-predict card runs/sinn/sinn.safetensors --real runs/judged/real.json
    """
    from hri_predict.lab.evaluation.card import publish

    print("written: " + ", ".join(map(str, publish(weights, real, benchmark, out))))
