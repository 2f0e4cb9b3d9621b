"""``check``: compare the cell with its commissioning report; show its evidence settings."""

import os
import shutil
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import demand_kind
from hri_predict.commissioning.identity import differences, identity_of
from hri_predict.commissioning.report import Report, find_report, read_report
from hri_predict.commissioning.simulated import is_simulated
from hri_predict.operation.evidence.chain import file_hash
from hri_predict.run.config import Config

# -- check: whether the cell is still the one that was commissioned; key by key what is not --------

AGAIN = "hri-predict commission"


def commissioning_facts(config: Config) -> dict[str, Any] | None:
    """Compare the cell with its report; ``None`` if the configuration names none.

    ``wrong`` has one line for each thing that does not match, ``again`` one for each step that was
    not done in this cell; ``notes`` holds remarks on a report that matches.
    """
    if config.node.commissioning is None:
        return None
    path = config.base_dir / config.node.commissioning.report
    try:
        path = find_report(path)
        report, digest = read_report(path)
    except ConfigError as error:
        return {"report": str(path), "wrong": [str(error)], "again": [], "notes": []}
    changed = [str(each) for each in differences(report.identity, identity_of(config))]
    return {
        "report": str(path),
        "hash": digest,
        "made": report.made.isoformat(),
        "outcome": report.outcome,
        "simulated": report.simulated,
        "changed": changed,
        "wrong": [*changed, *_damaged(path.parent, report)],
        "again": _again(report, config),
        "notes": _notes(report),
    }


def commissioning_lines(facts: dict[str, Any] | None) -> list[str]:
    """Return the facts of ``commissioning_facts`` as lines to read."""
    if facts is None:
        return ["commissioning: no report named; see docs/guides/commissioning.md"]
    wrong = [f"  no longer matches: {line}" for line in facts["wrong"]]
    if "made" not in facts:
        return ["commissioning: the report cannot be used", *wrong]
    day = facts["made"][:10]
    head = f"commissioning: {facts['outcome']} on {day}, hash {facts['hash'][:16]}"
    if wrong:
        return [f"{head}; NOT THIS CELL ANY MORE: commission it again ({AGAIN})", *wrong]
    again = [f"  {line}" for line in facts["again"]]
    if facts["outcome"] == "failed":
        head = f"{head}; NOT FIT TO BE SWITCHED ON: correct what failed, and continue ({AGAIN})"
        return [head, *again, *(f"  {note}" for note in facts["notes"])]
    if again:
        return [f"{head}; NOT EVERY STEP WAS DONE IN THIS CELL: do it again ({AGAIN})", *again]
    return [f"{head}; the cell is unchanged", *(f"  {note}" for note in facts["notes"])]


def is_as_commissioned(facts: dict[str, Any] | None) -> bool:
    """Whether the report and all its steps belong to this cell and nothing in it failed; true
    without a report.
    """
    if facts is None:
        return True
    return not facts["wrong"] and not facts["again"] and facts["outcome"] != "failed"


def _damaged(folder: Path, report: Report) -> list[str]:
    """Return the walk's files that have changed."""
    step = report.steps.walk
    if step is None or step.result is None:
        return []
    walk, found = step.result, []
    files = {walk.recording: walk.recording_sha256, walk.advices: walk.advices_sha256}
    for name, digest in files.items():
        try:
            if file_hash(folder / name) != digest:
                found.append(f"{name}: was changed after the report was written")
        except OSError as error:
            found.append(f"{name}: cannot be read: {error.strerror}")
    return found


def _again(report: Report, config: Config) -> list[str]:
    """Return the steps that were done in another cell: before a change, or in a simulation.

    Every step that is done or skipped makes the report one of the cell as it is then, also of the
    steps that were done earlier.
    """
    found, is_real = [], not is_simulated(config)
    for name, step in report.steps.named():
        if step is None:
            continue
        if step.identity != report.identity.hash:
            found.append(f"{name}: {step.outcome} before the cell was changed")
        elif step.simulated and step.outcome != "skipped" and is_real:
            found.append(f"{name}: {step.outcome} in a simulation, and this cell is real")
    return found


def _notes(report: Report) -> list[str]:
    notes = [f"not passed: {line}" for line in report.open]
    if report.simulated:
        notes.insert(0, "it was made with simulated people or controllers: nothing real was tried")
    return notes


# -- check: what the node would keep as evidence, and whether there is room for it -----------------


def evidence_facts(config: Config) -> dict[str, Any] | None:
    """Return the ``evidence:`` settings and the folder's state; ``None`` without them.

    Nothing is opened.

    Raises:
        ConfigError: the path is not a folder.
    """
    settings = config.node.evidence
    if settings is None:
        return None
    folder = config.base_dir / settings.folder
    try:
        demand_kind(folder, folder=True)
    except OSError as error:
        raise ConfigError(
            f"evidence.folder {folder}: {error.strerror}; name another folder"
        ) from error
    return {
        **settings.model_dump(),
        "folder": str(folder),
        "notes": _room_notes(folder, settings.max_mb),
    }


def evidence_line(facts: dict[str, Any] | None) -> str:
    """Return the facts of ``evidence_facts`` as a line to read."""
    if facts is None:
        return "evidence: not recorded"
    kinds = ", ".join(kind.replace("_", " ") for kind in facts["of"])
    return (
        f"evidence: {facts['before_s']:g} s before and {facts['after_s']:g} s after each {kinds}, "
        f"in {facts['folder']}, up to {facts['max_mb']:g} MB"
    )


def evidence_notes(facts: dict[str, Any] | None) -> list[str]:
    """Return the problems that would keep the node from writing evidence."""
    return [] if facts is None else list(facts["notes"])


def _room_notes(folder: Path, max_mb: float) -> list[str]:
    there = next((each for each in (folder, *folder.absolute().parents) if each.is_dir()), None)
    if there is None:
        return []
    if not os.access(there, os.W_OK):
        return [f"evidence.folder {folder}: {there} cannot be written by this user"]
    free_mb = shutil.disk_usage(there).free / 1e6
    if free_mb < max_mb:
        return [
            f"evidence.max_mb {max_mb:g}: only {free_mb:.0f} MB are free there; events are lost "
            f"when the disk is full"
        ]
    return []
