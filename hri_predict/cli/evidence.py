"""``evidence``: list the evidence of stops, near misses and faults, and verify it."""

import json
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import in_words
from hri_predict.cli.common import JsonOption
from hri_predict.operation.evidence import chain

LEAST_HASH = 8
"""Minimum number of a hash's characters that identify a line."""

_SHOWN = 50


def evidence(
    *,
    folder: Annotated[Path, typer.Argument(help="The folder: evidence.folder of the node.")],
    newest: Annotated[
        str | None,
        typer.Option(help="The newest hash as noted elsewhere, or its beginning: must be in it."),
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """List the evidence, count near misses, and verify the chain of hashes and all files.

    Example: hri-predict evidence evidence/ --newest 3f2a9c01

    Exit status 1: a line or a file was changed or is missing.
    """
    if newest is not None and len(newest) < LEAST_HASH:
        raise ConfigError(
            f"--newest '{newest}': too short to identify a line; give {LEAST_HASH} characters of "
            "its hash or more"
        )
    if not chain.exists(folder):
        raise ConfigError(f"{folder}: no {chain.LOG}; name the folder of evidence.folder")
    lines = list(chain.read(folder))
    wrong = [f"{line.log}, line {line.number}: {_text(line.wrong)}" for line in lines if line.wrong]
    hashes = [str(line.data.get("hash")) for line in lines if not line.wrong]
    wrong += [
        f"{_text(path.name)} is an earlier, damaged log; move it away once the cause is known"
        for path in sorted(folder.glob("evidence-*.broken.jsonl"))
    ]
    if newest is not None and not any(each.startswith(newest.lower()) for each in hashes):
        wrong.append(f"no line has the hash {newest}: lines were cut off at the end")
    events = [event for line in lines for event in _events(line)]
    notes = _notes(folder, lines)
    near = Counter(
        (str(e.get("robot")), str(e.get("body_part")), str(e.get("robot_link")))
        for e in events
        if e.get("kind") == "near_miss"
    )
    if as_json:
        found: dict[str, Any] = {"lines": len(lines), "wrong": wrong, "notes": notes}
        found |= {"events": events, "near_misses": _rows(near)}
        found["newest_hash"] = hashes[-1] if hashes else None
        print(json.dumps(found))
    else:
        _show(events, near)
        for each in (*notes, *wrong):
            print(each)
        end = f"newest hash {hashes[-1]}" if hashes else "no line is whole"
        print(f"{folder}: {len(lines)} lines, {len(wrong)} wrong; {end}")
    return 1 if wrong else 0


def _events(line: chain.Line) -> list[dict[str, Any]]:
    """The events of a line, each with its file; those of a wrong line are marked."""
    also = line.data.get("also")
    if not isinstance(also, list):
        return []
    first = {key: value for key, value in line.data.items() if key != "also"}
    shared = {"file": line.data.get("file"), "wrong": bool(line.wrong)}
    return [{**each, **shared} for each in (first, *also) if isinstance(each, dict)]


def _notes(folder: Path, lines: list[chain.Line]) -> list[str]:
    """Print what the chain does not show: runs without an end, and files that no line names."""
    notes, begun = [], ""
    for line in lines:
        kind = line.data.get("kind")
        if kind == "start" and begun:
            notes.append(f"note: the run that began {begun} has no end: the node was killed")
        if kind in ("start", "end"):
            begun = _text(line.data.get("at")) if kind == "start" else ""
    if begun:
        notes.append(f"note: the run that began {begun} has no end: it still runs, or was killed")
    named = {line.data.get("file") for line in lines}
    notes += [
        f"note: {_text(path.name)} is in no line: the node was killed while writing it"
        for path in sorted(folder.glob("*.mcap"))
        if path.name not in named
    ]
    return notes


def _rows(near: Counter[tuple[str, str, str]]) -> list[dict[str, Any]]:
    return [
        {"robot": robot, "body_part": part, "robot_link": link, "count": count}
        for (robot, part, link), count in near.most_common()
    ]


def _show(events: list[dict[str, Any]], near: Counter[tuple[str, str, str]]) -> None:
    console = Console()
    table = Table(title=f"Events, the newest {_SHOWN}; m: separation", title_justify="left")
    for column in ("UTC", "robot", "kind", "reason", "m", "body part, link"):
        table.add_column(column, overflow="fold", no_wrap=column == "UTC")
    file = None
    for event in events[-_SHOWN:]:
        if event["file"] != file:
            file = event["file"]
            table.add_section()
        at = _text(event.get("at"))[5:19].replace("T", " ")
        where = f"{_words(event.get('body_part'))}, {_words(event.get('robot_link'))}"
        what = (_words(event.get("kind")), _words(event.get("reason")).lower())
        marked = " (wrong)" if event["wrong"] else ""
        apart = _text(event.get("separation_m"))
        table.add_row(at, _text(event.get("robot")), *what, apart, where + marked)
    console.print(table)
    for name in dict.fromkeys(event["file"] for event in events[-_SHOWN:]):
        print(f"file: {_text(name)}")
    if near:
        counts = Table(title="Near misses", title_justify="left")
        for column in ("robot", "body part", "robot link", "count"):
            counts.add_column(column)
        for row in _rows(near):
            parts = (_words(row["body_part"]), _words(row["robot_link"]))
            counts.add_row(_text(row["robot"]), *parts, _text(row["count"]))
        console.print(counts)


def _words(value: Any) -> str:
    """Return a readable name; its words also let a narrow table wrap."""
    return in_words(_text(value))


def _text(value: Any) -> str:
    if value is None:
        return "-"
    text = f"{value:.2f}" if isinstance(value, float) else str(value)
    return "".join(c if c.isprintable() else "?" for c in text).replace("[", "(")
