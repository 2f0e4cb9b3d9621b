"""``simulate``: thousands of closed-loop approaches, to compare risk modes and predictors."""

import sys
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import (
    CalibrationsOption,
    ClusterOption,
    JointMapOption,
    JsonOption,
    check_out,
    files,
    map_path,
    one_of,
    processes,
    without_effect,
)
from hri_predict.lab.datasets.splits import USES
from hri_predict.risk.settings import RISK_MODES
from hri_predict.run import config as configuration
from hri_predict.run.compared_predictors import asked_predictors
from hri_sim.simulation.command.shown import counting, distances, occluded, show_report
from hri_sim.simulation.distance.people import ACTIVITIES, FULL, SETS, own_sights, sights
from hri_sim.simulation.request import (
    DistanceRequest,
    OcclusionRequest,
    SimulationRequest,
)

T = TypeVar("T")
_PROCEDURAL = "procedural"
_SCRIPTS = 24  # procedural motions stand for as many recordings


def simulate(
    *,
    config: Annotated[
        Path | None,
        typer.Argument(
            help="Configuration whose source has kind: approach; with --distance, any cell.",
            show_default="simulate.yaml; with --distance, working_distance.yaml",
        ),
    ] = None,
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
            help="Risk mode; default: the configuration's. 'foreknown' is mode predictive with "
            "the true future, an upper bound for any forecast. Repeatable."
        ),
    ] = None,
    coverage: Annotated[
        list[float] | None,
        typer.Option(help="Also simulate mode predictive with zones of this coverage. Repeatable."),
    ] = None,
    episodes: Annotated[
        int | None,
        typer.Option(min=1, max=1_000_000, help="Number of approaches.", show_default="2000"),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0, help="Random seed of places, phases and message losses.", show_default="0"
        ),
    ] = None,
    people: Annotated[
        int | None, typer.Option(min=1, max=4, help="Number of people at once.", show_default="1")
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
        list[str] | None,
        typer.Option(
            help="Tracker whose joints are delivered: a joint map's name (coco17) or file, or "
            f"{', '.join(own_sights())}; joined by + if several apply (coco17+legs-hidden); "
            "repeatable with --distance.",
        ),
    ] = None,
    noise: Annotated[
        list[float] | None,
        typer.Option(
            min=0,
            max=0.2,
            help="Noise on each observed coordinate: standard deviation, m. With --distance, "
            "repeatable.",
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
        Path | None, typer.Option(help="Folder for tables, plots and the data for --resume.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the run in --out.")] = False,
    occlude: Annotated[
        bool,
        typer.Option(
            "--occlude",
            help="Simulate people who get lost behind boxes and other people, with new ids when "
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
            help="With --occlude: number of cameras; 0: nothing is hidden.",
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
            help="With --occlude: number of the first episode, to split a long run or to repeat "
            "one episode.",
            show_default="0",
        ),
    ] = None,
    distance: Annotated[
        bool,
        typer.Option(
            "--distance",
            help="Measure the minimum distance at which people may work while the robot runs, "
            "by activity and tracker.",
        ),
    ] = False,
    error: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=3,
            help="With --distance: position error of each person, as stated by the tracker, m.",
            show_default="0",
        ),
    ] = None,
    activity: Annotated[
        list[str] | None,
        typer.Option(
            help=f"With --distance: activity of the person ({', '.join(ACTIVITIES)}), each "
            f"recording of a set of the data pack ({', '.join(SETS)}), or one of your own. "
            "Repeatable.",
            show_default="window tools talking",
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            help="With --distance: name of the robot.", show_default="the first that moves"
        ),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(
            min=4,
            max=600,
            help="With --distance: time to measure each person, s; the first 2.5 s do not count.",
            show_default="8",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Simulate people who approach a robot that follows the advice, and count contacts and stops.

    Example: hri-predict simulate --mode predictive --mode iso --episodes 200 --out runs/closed_loop

    With --distance, measure instead the minimum distance at which a person may work while the robot
    runs.

    Example: hri-predict simulate --distance --activity window --tracker full --tracker coco17

    Exit status 1: a simulated episode disagrees with the whole node, or, with --occlude, a person
    was touched by a moving robot.
    """
    jobs = processes(jobs, cluster, default=2)
    approaches = {
        "--coverage": coverage,
        "--calibration": calibration,
        "--people": people,
        "--split": split,
        "--joint-map": joint_map,
        "--wander": wander,
        "--resume": resume or None,
    }
    lost = {
        "--rates": rates,
        "--cameras": cameras,
        "--free-space": free_space or None,
        "--first": first,
    }
    near = {"--activity": activity, "--robot": robot, "--seconds": seconds, "--error": error}
    if distance:
        others = {"--occlude": occlude or None, "--episodes": episodes, "--seed": seed}
        without_effect({**approaches, **lost, **others}, "with --distance")
        if out is not None:
            check_out(out)
        return distances(
            DistanceRequest(
                config=configuration.find(config or Path("working_distance.yaml")),
                robot=robot,
                activities=_each_once("--activity", activity),
                trackers=_each_once("--tracker", tracker),
                noises_m=tuple(noise or ()),
                error_m=error or 0.0,
                predictors=_predictors(predictor or []),
                modes=_each_once("--mode", mode),
                data=_one("--data", data, "--distance"),
                seconds=seconds,
                jobs=jobs,
                cluster=cluster,
                out=out,
            ),
            as_json=as_json,
        )
    without_effect(near, "without --distance")
    config, seed = config or Path("simulate.yaml"), seed or 0
    episodes = 2000 if episodes is None else episodes
    if occlude:
        without_effect(
            {
                **approaches,
                "--data": data,
                "--tracker": tracker,
                "--noise": noise,
                "--out": out,
            },
            "with --occlude",
        )
        for each in mode or ():
            one_of("--mode", each, RISK_MODES)
        cameras = 1 if cameras is None else cameras
        return occluded(
            OcclusionRequest(
                config=configuration.find(config),
                predictor=_shipped_weights(_one("--predictor", predictor, "--occlude")),
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
    without_effect(lost, "without --occlude")
    if data and all(str(entry) == _PROCEDURAL for entry in data):
        without_effect({"--joint-map": joint_map}, f"on {_PROCEDURAL} people alone")
    seen_as = _one("--tracker", tracker, "a simulation of approaches")
    sight = FULL if seen_as is None else sights([seen_as])[0]
    from hri_sim import simulation

    if out is not None:
        check_out(out)
    elif resume:
        raise ConfigError("--resume: needs the folder of the run; add --out")
    request = SimulationRequest(
        config=configuration.find(config),
        predictors=_predictors(predictor or []),
        calibrations=tuple(path.absolute() for path in calibration or ()),
        modes=_each_once("--mode", mode),
        coverages=tuple(coverage or ()),
        motions=_motions(data or [_default_data()], split),
        joint_map=None if joint_map is None else map_path(joint_map),
        tracker=sight.tracker,
        lacks=sight.lacks,
        hidden=sight.hidden,
        lost_limbs=sight.lost,
        noise_m=_one("--noise", noise, "a simulation of approaches"),
        wander_m=wander,
        episodes=episodes,
        seed=seed,
        people=people or 1,
        jobs=jobs,
        cluster=cluster,
        out=out,
        resume=resume,
    )
    with counting("approaches") as progress:
        report = simulation.run(request, progress)
    if as_json:
        print(report.json)
    else:
        show_report(report)
    for line in report.disagreements:
        print(f"disagrees with the whole node: {line}", file=sys.stderr)
    return 1 if report.disagreements else 0


def _each_once(flag: str, names: list[str] | None) -> tuple[str, ...]:
    for name in names or ():
        if (names or []).count(name) > 1:
            raise ConfigError(f"{flag} {name}: given twice; name each once")
    return tuple(names or ())


def _predictors(texts: list[str]) -> tuple[str, ...]:
    """Return ``NAME`` or ``NAME=WEIGHTS``, with the absolute path for other processes."""
    asked = asked_predictors(texts)
    return tuple(a.name if a.weights is None else f"{a.name}={a.weights.absolute()}" for a in asked)


def _one(flag: str, values: list[T] | None, where: str) -> T | None:
    if values and len(values) > 1:
        raise ConfigError(f"{flag}: {where} takes one; name one")
    return values[0] if values else None


def _shipped_weights(predictor: str | None) -> str | None:
    if predictor is not None and "=" in predictor:
        raise ConfigError(
            f"--predictor {predictor}: not with --occlude; name weights in the configuration"
        )
    return predictor


def _default_data() -> Path:
    """Return the data pack next to the project.

    Raises:
        ConfigError: it is not there.
    """
    folder = Path("../shared/data")
    if not folder.exists():
        raise ConfigError(
            f"the data pack with recordings of people is not in {folder}; name its folder or your "
            f"own recordings with --data, or take scripted people: --data {_PROCEDURAL}"
        )
    return folder


def _motions(data: list[Path], split: str | None) -> tuple[str, ...]:
    """Return the names of all motions, each once."""
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
