"""``commission``: guide an integrator through the validation of one cell, and write the report."""

import json
import shlex
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.settings import validated
from hri_predict.cli.commission.answers import Answers, ask_text, asked, read_answers
from hri_predict.cli.commission.steps import Task, do_step
from hri_predict.cli.common import JsonOption, check_writable, one_of, without_effect
from hri_predict.cli.register.points import say
from hri_predict.commissioning.compare import Comparison, compare
from hri_predict.commissioning.folder import State, load_state, save
from hri_predict.commissioning.identity import Difference, differences, identity_of
from hri_predict.commissioning.playback import REPLAYED, grid_of, play, read_rows
from hri_predict.commissioning.report import (
    PAGE,
    REPORT,
    STEPS,
    Report,
    Step,
    find_report,
    read_report,
)
from hri_predict.operation.evidence.chain import file_hash
from hri_predict.run import config as configuration
from hri_predict.run.config import Config


def commission(
    *,
    config: Annotated[
        Path | None, typer.Argument(help="The node's YAML configuration.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for state, recording and report; it may already exist."),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(help=f"Do only this step, even if it has passed: {', '.join(STEPS)}."),
    ] = None,
    answers: Annotated[
        Path | None, typer.Option(help="YAML file of answers, used instead of prompts.")
    ] = None,
    skip: Annotated[
        list[str] | None, typer.Option(help="STEP=WHY: skip the step, with this note. Repeatable.")
    ] = None,
    note: Annotated[list[str] | None, typer.Option(help="An open note. Repeatable.")] = None,
    by: Annotated[str | None, typer.Option(help="Person who does it.")] = None,
    simulate: Annotated[
        bool,
        typer.Option("--simulate", help="Use simulated people and controllers; do not prompt."),
    ] = False,
    repeat: Annotated[
        Path | None,
        typer.Option(help="Replay the walk test of this report and show what has changed since."),
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Validate a cell step by step, and write report.json and report.html.

    The steps are registration (touched points), echo (reaction time of the links), stopping
    (against the stopping table; robots move) and walk (where people are seen). Steps that passed
    are not repeated, unless --step names them or the cell has changed. Exit status 1 if a step
    failed or is open: with --step that step, without it any of the four.

    With --repeat, exit status 1 if anything became less safe, or too little of the floor now
    required was walked.

    Example: hri-predict commission cell.yaml --out commissioning
    """
    if repeat is not None:
        flags: dict[str, Any] = {"--out": out, "--step": step, "--answers": answers, "--skip": skip}
        flags |= {"--note": note, "--by": by, "--simulate": simulate or None}
        without_effect(flags, "with --repeat")
        return repeat_walk(repeat, config, as_json)
    if config is None:
        raise ConfigError("CONFIG: missing; name the configuration, or a report with --repeat")
    if out is None:
        raise ConfigError("--out: missing; name a folder for the report")
    names = [str(one_of("--step", step, STEPS))] if step is not None else list(STEPS)
    said = _with_flags(read_answers(answers), skip, note, by)
    if step is not None:
        others = {f"--skip {text}": text for text in skip or () if text.partition("=")[0] != step}
        without_effect(others, f"with --step {step}")
    loaded = configuration.load(config)
    state = load_state(out, loaded)
    check_writable(out)
    interactive = answers is None and not simulate and sys.stdin.isatty()
    task = Task(config=loaded, answers=said, folder=out, simulate=simulate, interactive=interactive)
    task, state = _go(task, state, names, again=step is not None)
    state = _closing(task, state)
    report, digest = save(out, task.config, state)
    _show(report, digest, out, as_json)
    return 0 if all(_is_settled(task, state, name) for name in names) else 1


def _go(task: Task, state: State, names: list[str], again: bool) -> tuple[Task, State]:
    """Do the pending steps, and save after each."""
    for name in names:
        skips = name in task.answers.skip
        if not again and not skips and _is_settled(task, state, name):
            say(f"{name}: passed before; --step {name} does it again")
            continue
        if task.interactive and not skips:
            heard = asked(task.answers, name)
            if heard is None:
                break
            task = replace(task, answers=heard)
        done, changed = do_step(name, task)
        task = replace(task, config=changed)
        state = state.with_step(name, done)
        save(task.folder, task.config, state)
        kept: Step[Any] = getattr(state.steps, name)
        say(f"{name}: {kept.outcome}{f': {kept.note}' if kept.note else ''}")
        for line in kept.why:
            say(f"  {line}")
    return task, state


def _is_settled(task: Task, state: State, name: str) -> bool:
    """Whether a step passed, or was skipped on purpose, in the unchanged cell.

    A simulated step does not count if the cell is now real.
    """
    step: Step[Any] | None = getattr(state.steps, name)
    if step is None or step.outcome not in ("passed", "skipped"):
        return False
    if step.simulated and not task.is_simulated:
        return False
    return step.identity == identity_of(task.config).hash


def _with_flags(
    answers: Answers, skip: list[str] | None, notes: list[str] | None, by: str | None
) -> Answers:
    """Return the answers, overridden by the command line.

    Raises:
        ConfigError: ``--skip`` without a note, or of a step that does not exist; a text is too
            long.
    """
    skipped = {str(name): why for name, why in answers.skip.items()}
    for text in skip or ():
        name, _, why = text.partition("=")
        if not why.strip():
            raise ConfigError(f"--skip {text}: give the reason: --skip {name}=WHY")
        skipped[one_of("--skip", name, STEPS)] = why.strip()
    said = answers.model_dump()
    for flag, given, changes in (
        ("--skip", skip, {"skip": skipped}),
        ("--note", notes, {"notes": [*(answers.notes or ()), *(notes or ())]}),
        ("--by", by, {"by": by}),
    ):
        if given is not None:
            said = validated(Answers, said | changes, flag).model_dump()
    return Answers.model_validate(said)


def _closing(task: Task, state: State) -> State:
    """Prompt for open notes and the name of the responsible person."""
    notes, signatures = task.answers.notes, task.answers.signatures
    if task.interactive:
        typed = []
        while line := ask_text("An open note (empty: none):"):
            typed.append(line)
        notes = [*dict.fromkeys((*state.notes, *(notes or ()), *typed))]
    changes: dict[str, Any] = {}
    if notes is not None:
        changes["notes"] = notes
    if signatures is not None:
        changes["signatures"] = signatures
    return state.model_copy(update=changes)


def _show(report: Report, digest: str, out: Path, as_json: bool) -> None:
    if as_json:
        outcomes = {name: None if s is None else s.outcome for name, s in report.steps.named()}
        found = {"outcome": report.outcome, "steps": outcomes, "open": report.open}
        print(json.dumps({**found, "report": str(out / REPORT), "hash": digest}))
        return
    for line in report.open:
        print(f"not passed: {line}")
    if report.simulated:
        print("SIMULATED: not valid for the real cell")
    print(f"{out / REPORT}: {report.outcome}; hash {digest}")
    print(f"{out / PAGE}: to read and to print")
    print(f"add to the configuration, so that check compares: commissioning: {out / REPORT}")


# -- commission --repeat: the recorded walk, through the present version and configuration ---------


def repeat_walk(path: Path, config: Path | None, as_json: bool) -> int:
    """Replay a report's walk and print the changes; 1 if less safe or not walked.

    Raises:
        HriPredictError: the report, its recording or the configuration cannot be used.
    """
    if not path.is_dir() and not path.is_file():
        raise ConfigError(f"--repeat {path}: no such file or folder; name a report or its folder")
    where = find_report(path)
    report, _ = read_report(where)
    walk = report.steps.walk.result if report.steps.walk is not None else None
    if walk is None:
        raise ConfigError(f"report {where}: no walk test; do it first (--step walk)")
    loaded = configuration.load(config or _own(where, report))
    recording = _whole(where.parent, walk.recording, walk.recording_sha256)
    old = read_rows(_whole(where.parent, walk.advices, walk.advices_sha256))
    changed = differences(report.identity, identity_of(loaded))
    played = play(loaded, recording, grid_of(loaded, walk.grid.cell_m, walk.exclude))
    found = compare(walk, old, played)
    found.worse += [
        f"{each}: {_CANNOT_TELL}, recorded with the old value; walk again"
        for each in changed
        if _is_of_recording(each.key)
    ]
    _show_again(loaded, changed, found, as_json)
    return 1 if found.worse or found.unwalked else 0


def _own(where: Path, report: Report) -> Path:
    """Return the configuration of the report, from the report's folder."""
    path = where.parent / report.config_path
    if not path.is_file():
        raise ConfigError(
            f"report {where}: its configuration {report.config_path} is missing; name it: "
            f"hri-predict commission CONFIG --repeat {shlex.quote(str(where))}"
        )
    return path


def _whole(folder: Path, name: str, digest: str) -> Path:
    """Return the path of a report's file, if it is unchanged.

    Raises:
        RecordingError: it is missing or was changed.
    """
    path = folder / name
    try:
        found = file_hash(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}; restore it") from error
    if found != digest:
        raise RecordingError(
            f"{path}: was changed after the report was written; restore it, or walk again"
        )
    return path


_CANNOT_TELL = "the recording cannot show this"


def _is_of_recording(key: str) -> bool:
    """Whether a changed key took effect while the walk was recorded.

    A replay cannot show the effect then.
    """
    if key.startswith("version of the code of source "):
        return True
    section, _, own = key.removeprefix("file of ").partition(" (")[0].partition(".")
    return section == "source" and own.partition(".")[0] not in REPLAYED


def _show_again(
    config: Config, changed: list[Difference], found: Comparison, as_json: bool
) -> None:
    if as_json:
        data = {"config": str(config.path), "changed": [asdict(each) for each in changed]}
        lines = {"less_safe": found.worse, "not_walked": found.unwalked, "other": found.other}
        print(json.dumps({**data, **lines}))
        return
    for each in changed:
        print(f"changed: {each}")
    for line in found.other:
        print(f"differs: {line}")
    for line in found.worse:
        print(f"{'NOT KNOWN' if _CANNOT_TELL in line else 'LESS SAFE'}: {line}")
    for line in found.unwalked:
        print(f"NOT WALKED: {line}")
    if not (found.worse or found.unwalked or found.other):
        print("the recorded walk gives the same advice, tick by tick")
    elif not found.worse:
        print("nothing became less safe")
