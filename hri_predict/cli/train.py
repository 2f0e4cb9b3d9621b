"""``train``: train a predictor on recorded motion. ``ablate``: compare augmentations."""

import json
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.cli.common import JointMapOption, command, own_map, warn
from hri_predict.lab.training.config import load_training_config

if TYPE_CHECKING:
    from hri_predict.lab.training.config import TrainingConfig
    from hri_predict.lab.training.loop import Result


def train(
    *,
    config: Annotated[
        Path, typer.Argument(help="A YAML file of configs/training, your own, or a list of them.")
    ],
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue from the run's last checkpoint.")
    ] = False,
    data: Annotated[Path | None, typer.Option(help="Folder of the recordings.")] = None,
    joint_map: JointMapOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the run.")] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", help="key.key=value: change a key of the YAML. Repeatable."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="List the runs and their progress without training.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print only the summary, as JSON.")
    ] = False,
) -> None:
    """Train a predictor. Ctrl-C saves the run; --resume continues it and gives the same weights.

    The run's folder holds the best weights, checkpoints and a TensorBoard log. A list of
    configurations, such as configs/training/all.yaml (all shipped weights, most valuable first), is
    trained in order; the same command continues it.

    To use several processes:
    torchrun --nproc-per-node 2 -m hri_predict train CONFIG

    Example: hri-predict train configs/training/trajectorycnn_real.yaml --set train.epochs=20
    """
    flags = _changes(changes, data, joint_map, None)
    path = _found(config)
    # torch takes seconds to import; the other commands need not wait for it
    from hri_predict.lab.training import runs
    from hri_predict.lab.training.processes import Processes
    from hri_predict.lab.training.stopping import told_to_stop

    plan = runs.read_plan(path)
    if plan is None:
        asked = [load_training_config(path, [*flags, *_changes(None, None, None, out)])]
    elif out is not None:
        raise ConfigError(f"--out: each run of {path} names its own folder; leave it out")
    else:
        files = [path.parent / each.config for each in plan]
        asked = [
            load_training_config(f, [*p.set, *flags]) for f, p in zip(files, plan, strict=True)
        ]
    for settings in asked:
        _demand_keys(settings, {"--data": data, "--joint-map": joint_map})
    if dry_run:
        for each in asked:
            longest = each.train.max_minutes
            limit = "" if longest is None else f", at most {longest:g} min"
            print(f"{each.out}: {each.train.epochs} epochs{limit}: {runs.state(each)}")
        return
    for settings in asked:  # before the first of them trains for hours
        runs.check_run_folder(settings, runs.begun(settings) if plan else resume)
    for settings in asked:
        if settings.train.patience and settings.data.get("refit"):
            warn("train.patience has no effect with data.refit, which leaves no validation data")
        with Processes.join() as processes, told_to_stop() as stop:
            result = runs.trained(
                settings,
                resume=runs.begun(settings) if plan else resume,
                stop=stop,
                processes=processes,
                command=command(),
            )
        if processes.rank == 0:
            _show(result, settings.error_unit, as_json)
        # asked to stop in its last step, a run is finished; processes must agree, so this one alone
        before_next = settings is not asked[-1] and processes.count == 1 and stop()
        if result.ending == "interrupted" or before_next:
            if processes.rank == 0:
                again = _again(plan is None, processes.count)
                print(f"saved; continue with: {again}", file=sys.stderr)
            raise typer.Exit(130)


def _again(one_run: bool, processes: int) -> str:
    """Return the command that continues one run, or a plan, with the same number of processes."""
    words = [word for word in sys.argv[1:] if word != "--resume"]
    words += ["--resume"] if one_run else []
    program = ["hri-predict"]
    if processes > 1:
        program = ["torchrun", "--nproc-per-node", str(processes), "-m", "hri_predict"]
    return shlex.join([*program, *words])


def _found(path: Path) -> Path:
    """Return ``path``, or the shipped configuration of that name (``configs/training/…``)."""
    inside = path.parts[2:] if path.parts[:2] == ("configs", "training") else path.parts
    shipped = data_path("training", *inside)
    return shipped if shipped.is_file() and not path.exists() else path


def _changes(
    changes: list[str] | None, data: Path | None, joint_map: str | None, out: Path | None
) -> list[str]:
    """Return all flags as changes of the configuration."""
    found = list(changes or [])
    if data is not None:
        found.append(f"data.root={json.dumps(str(data))}")
    if joint_map is not None:
        own_map(joint_map)  # tell a mistake in the flag's own words
        found.append(f"data.joint_map={json.dumps(joint_map)}")
    if out is not None:
        found.append(f"out={json.dumps(str(out))}")
    return found


_KEYS = {"--data": "root", "--joint-map": "joint_map"}


def _demand_keys(config: "TrainingConfig", flags: dict[str, object]) -> None:
    """Refuse a flag whose key the data set lacks.

    Raises:
        ConfigError: it lacks one, or the data set does not exist.
    """
    from hri_predict.lab.training.parts import part

    for flag, key in _KEYS.items():
        known = part("data_sets", config.judgement).settings_model.model_fields
        if flags[flag] is not None and key not in known:
            raise ConfigError(
                f"{flag}: data set '{config.judgement}' has no key data.{key}; leave {flag} out"
            )


def _show(result: "Result", unit: str, as_json: bool) -> None:
    if as_json:
        print(json.dumps(result.as_dict()))
        return
    print(f"{result.ending}: {result.epochs} epochs in {result.minutes:.1f} minutes")
    if not result.weights.exists():
        print("no weights yet")
        return
    if result.validation is not None:
        print(
            f"best validation: {result.validation['mpjpe_mm']:.1f} {unit} "
            f"in epoch {result.best_epoch}"
        )
    print(f"weights: {result.weights}")


def ablate(
    *,
    config: Annotated[
        Path,
        typer.Argument(
            help="Training configuration of trajectorycnn, judgement real; or a paper's network: "
            "trajectorycnn, stb, auxformer, kdformer, sinn."
        ),
    ],
    data: Annotated[str, typer.Option(help="Folder of the recordings.")],
    out: Annotated[str, typer.Option(help="Folder of the runs and of the table.")],
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", help="key.key=value: change a key of the YAML. Repeatable."),
    ] = None,
) -> None:
    """Train a small TrajectoryCNN with one augmentation left out at a time, and compare errors.

    With a paper's name, train the paper's own network with one switch of its ablation at a time.

    Ctrl-C saves the run; the same command continues. Finished runs are not run again.

    Example: hri-predict ablate configs/training/trajectorycnn_real.yaml --data ../shared/data
    --out runs/ablation
    """
    from hri_predict.lab.training import ablation, paper_ablation

    try:
        if str(config) in paper_ablation.PAPERS:
            print(paper_ablation.ablate(str(config), data, Path(out), changes or []), end="")
            return
        text = ablation.ablate(ablation.configuration(_found(config), data, out, changes or ()))
    except KeyboardInterrupt:
        print("saved; continue with the same command", file=sys.stderr)
        raise typer.Exit(130) from None
    print(text, end="")
