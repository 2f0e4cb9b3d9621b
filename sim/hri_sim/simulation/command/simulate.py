"""``simulate``: thousands of closed-loop approaches, to compare risk modes and predictors."""

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import (
    CalibrationsOption,
    ClusterOption,
    JointMapOption,
    files,
    map_path,
    need_plots,
    one_of,
    processes,
    progress,
    without_effect,
)
from hri_predict.lab.datasets.splits import USES
from hri_predict.risk.settings import RISK_MODES
from hri_predict.run import config as configuration
from hri_predict.run.compared_predictors import asked_predictors
from hri_sim.simulation.command.occlude import occluded
from hri_sim.simulation.request import OcclusionRequest, SimulationReport, SimulationRequest

_PROCEDURAL = "procedural"
_SCRIPTS = 24  # procedural motions stand for as many recordings


def simulate(
    *,
    config: Annotated[
        Path, typer.Argument(help="Configuration with a source of kind: approach.")
    ] = Path("simulate.yaml"),
    predictor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[=WEIGHTS]",
            help="Predictor, or with your own weights: mixer=best.safetensors; default: the "
            "configuration's. Repeatable.",
        ),
    ] = None,
    calibration: CalibrationsOption = None,
    mode: Annotated[
        list[str] | None,
        typer.Option(
            help="Risk mode; default: the configuration's. 'foreknown' is mode predictive with the "
            "true future, which no forecast can beat. Repeatable."
        ),
    ] = None,
    coverage: Annotated[
        list[float] | None,
        typer.Option(help="Also simulate mode predictive with zones of this coverage. Repeatable."),
    ] = None,
    episodes: Annotated[
        int, typer.Option(min=1, max=1_000_000, help="Number of approaches.")
    ] = 2000,
    seed: Annotated[
        int, typer.Option(min=0, help="Random seed of places, phases and message losses.")
    ] = 0,
    people: Annotated[
        int | None, typer.Option(min=1, max=4, help="People at once.", show_default="1")
    ] = None,
    data: Annotated[
        list[Path] | None,
        typer.Option(
            help="Folder of the data pack, other recordings, or 'procedural'. Repeatable.",
            show_default="../shared/data",
        ),
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(help="Split of the data pack: test, test_motion, ...", show_default="test"),
    ] = None,
    joint_map: JointMapOption = None,
    tracker: Annotated[
        str | None,
        typer.Option(
            help="See people as this tracker delivers them: a joint map's name (coco17) or file.",
        ),
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option(
            min=0, max=0.2, help="Noise on each coordinate that is seen: standard deviation, m."
        ),
    ] = None,
    wander: Annotated[
        float | None,
        typer.Option(min=0, max=0.2, help="Noise correlated over 0.3 s: standard deviation, m."),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(min=1, max=256, help="Number of processes.", show_default="2"),
    ] = None,
    cluster: ClusterOption = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for tables, plots and what --resume needs.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the run in --out.")] = False,
    occlude: Annotated[
        bool,
        typer.Option(
            "--occlude",
            help="People lost by cameras behind boxes and each other, with new ids when they are "
            "found again; through the whole node.",
        ),
    ] = False,
    rates: Annotated[
        list[float] | None,
        typer.Option(
            min=1,
            max=240,
            help="With --occlude: captures per second. Repeatable.",
            show_default="8 15 30",
        ),
    ] = None,
    cameras: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=4,
            help="With --occlude: cameras; 0: nothing is hidden.",
            show_default="1",
        ),
    ] = None,
    free_space: Annotated[
        bool, typer.Option("--free-space", help="With --occlude: the cameras see free space.")
    ] = False,
    first: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=1_000_000_000,
            help="With --occlude: number of the first episode, to play a long run in parts or one "
            "episode again.",
            show_default="0",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON.")] = False,
) -> int:
    """Simulate people who approach a robot that follows the advice, and count what happens.

    Example: hri-predict simulate --mode predictive --mode iso --episodes 200 --out runs/closed_loop

    Exit status 1: a simulated episode disagrees with the whole node, or, with --occlude, a person
    was touched by a moving robot.
    """
    jobs = processes(jobs, cluster, default=2)
    if occlude:
        without_effect(
            {
                "--coverage": coverage,
                "--calibration": calibration,
                "--people": people,
                "--data": data,
                "--split": split,
                "--joint-map": joint_map,
                "--tracker": tracker,
                "--noise": noise,
                "--wander": wander,
                "--out": out,
                "--resume": resume or None,
            },
            "with --occlude",
        )
        for each in mode or ():
            one_of("--mode", each, RISK_MODES)
        cameras = 1 if cameras is None else cameras
        return occluded(
            OcclusionRequest(
                config=configuration.find(config),
                predictor=_one("--predictor", predictor),
                modes=_each_once("--mode", mode) or ("predictive", "iso", "fixed"),
                rates_hz=tuple(rates or (8.0, 15.0, 30.0)),
                episodes=episodes,
                first=first or 0,
                seed=seed,
                cameras=max(cameras, 1),
                free_space=free_space,
                occlude=cameras > 0,
                jobs=jobs,
                cluster=cluster,
            ),
            as_json=as_json,
        )
    without_effect(
        {
            "--rates": rates,
            "--cameras": cameras,
            "--free-space": free_space or None,
            "--first": first,
        },
        "without --occlude",
    )
    from hri_sim import simulation

    if out is not None:
        need_plots()
    if resume and out is None:
        raise ConfigError("--resume: needs the folder of the run; give --out as well")
    request = SimulationRequest(
        config=configuration.find(config),
        predictors=_predictors(predictor or []),
        calibrations=tuple(path.absolute() for path in calibration or ()),
        modes=_each_once("--mode", mode),
        coverages=tuple(coverage or ()),
        motions=_motions(data or [Path("../shared/data")], split),
        joint_map=None if joint_map is None else map_path(joint_map),
        tracker=None if tracker is None else map_path(tracker),
        noise_m=noise,
        wander_m=wander,
        episodes=episodes,
        seed=seed,
        people=people or 1,
        jobs=jobs,
        cluster=cluster,
        out=out,
        resume=resume,
    )
    with progress() as bar:
        task = bar.add_task("approaches", total=None)
        report = simulation.run(
            request, lambda done, total: bar.update(task, completed=done, total=total)
        )
    if as_json:
        print(report.json)
    else:
        _show(report)
    for line in report.disagreements:
        print(f"disagrees with the whole node: {line}", file=sys.stderr)
    return 1 if report.disagreements else 0


def _each_once(flag: str, names: list[str] | None) -> tuple[str, ...]:
    for name in names or ():
        if (names or []).count(name) > 1:
            raise ConfigError(f"{flag} {name}: given twice; name each once")
    return tuple(names or ())


def _predictors(texts: list[str]) -> tuple[str, ...]:
    """``NAME`` or ``NAME=WEIGHTS`` by its whole path, so that every process finds the file."""
    asked = asked_predictors(texts)
    return tuple(a.name if a.weights is None else f"{a.name}={a.weights.absolute()}" for a in asked)


def _one(flag: str, names: list[str] | None) -> str | None:
    if names and len(names) > 1:
        raise ConfigError(f"{flag}: --occlude takes one; name one")
    if names and "=" in names[0]:
        raise ConfigError(
            f"{flag} {names[0]}: --occlude takes no weights; name them in the configuration"
        )
    return names[0] if names else None


def _motions(data: list[Path], split: str | None) -> tuple[str, ...]:
    """Names of all motions, each once."""
    if split is not None:
        one_of("--split", split, USES)
    recorded = [entry for entry in data if str(entry) != _PROCEDURAL]
    if len(data) - len(recorded) > 1:
        raise ConfigError(f"--data: {_PROCEDURAL} is named twice; name it once")
    if split is not None and not recorded:
        raise ConfigError(f"--split {split}: has no effect on {_PROCEDURAL}; leave it out")
    found = [str(path.resolve()) for path in files(recorded, split)]
    if len(recorded) < len(data):
        found += [f"{_PROCEDURAL}:{seed}" for seed in range(_SCRIPTS)]
    return tuple(found)


def _show(report: SimulationReport) -> None:
    console = Console()
    for table in report.tables:
        shown = Table(
            title=table.title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0)
        )
        # one column per variant: a row of intervals is wider than a terminal
        labels = 1 + (table.columns[1] == "mode")
        shown.add_column("", overflow="fold")
        for row in table.rows:
            shown.add_column("\n".join(row[:labels]), justify="right", overflow="fold")
        for k, column in enumerate(table.columns[labels:], labels):
            shown.add_row(column, *(row[k] for row in table.rows))
        console.print(shown)
    for note in report.notes:
        console.print(f"- {note}", markup=False, highlight=False)
    for path in report.files:
        print(f"written: {path}", file=sys.stderr)
