"""``init``: write a first configuration that passes ``check`` as it is."""

import json
import os
import shlex
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import YAML_ENDINGS, load_yaml
from hri_predict.base.quantities.units import phrase
from hri_predict.base.set_key import set_key
from hri_predict.cli.common import tell, without_effect
from hri_predict.cli.generate.config import write
from hri_predict.cli.init.cell import DOORS_M, Answers, cell, hints
from hri_predict.cli.init.questions import Asker, ask_all
from hri_predict.cli.settings_page.schema import Schema

SCHEMA_FILE = "hri-predict.schema.json"

_LONGEST_NAME = 200  # bytes: beside it comes a file with a longer one while it is written


def init(
    *,
    path: Annotated[Path, typer.Argument(metavar="CELL.yaml", help="The file to write.")] = Path(
        "cell.yaml"
    ),
    robot: Annotated[
        str | None, typer.Option(help="Shipped name, such as ur5e, or a robot file.")
    ] = None,
    max_speed: Annotated[
        float | None, typer.Option(help="Maximum speed of the robot's fastest point, m/s.")
    ] = None,
    source: Annotated[
        str | None, typer.Option(help="Kind of source, such as udp, json, mvn.")
    ] = None,
    joint_map: Annotated[
        str | None,
        typer.Option(help="The sender's joints: a shipped joint map, such as coco17, or a file."),
    ] = None,
    link: Annotated[
        list[str] | None,
        typer.Option(help="can:INTERFACE:CHANNEL, serial:PORT, a kind, or none. Repeatable."),
    ] = None,
    mode: Annotated[str | None, typer.Option(help="Mode of the risk stage.")] = None,
    predictor: Annotated[
        str | None, typer.Option(help="Predictor of people's motion, such as average.")
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Set any key, such as source.port=47801."),
    ] = None,
    simulated: Annotated[
        bool | None,
        typer.Option(
            "--simulated", help="Simulate controllers and a person, so no hardware is needed."
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Do not prompt; use the defaults.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
    with_schema: Annotated[
        bool,
        typer.Option("--schema/--no-schema", help=f"Write {SCHEMA_FILE} next to it, for editors."),
    ] = True,
) -> None:
    """Write a first configuration, with a comment for each key.

    It prompts for everything that no flag gives. The result passes check as written; with
    --simulated, "hri-predict run" moves an arm immediately.

    Example: hri-predict init cell.yaml --simulated --yes
    """
    beside = path.parent / SCHEMA_FILE
    _refuse_existing(path, beside if with_schema else None, force)
    if simulated:
        unused = {"--source": source, "--joint-map": joint_map, "--link": link or None}
        without_effect(unused, "with --simulated")
    asker = Asker(yes)
    given = [source, joint_map, *(link or [])]
    answers = ask_all(
        asker,
        base_dir=path.parent,
        simulated=False if simulated is None and (yes or any(given)) else simulated,
        robot=robot,
        max_speed=max_speed,
        source=source,
        joint_map=joint_map,
        links=link or [],
        mode=mode,
        predictor=predictor,
        changes=change or [],
    )
    from hri_predict.cli.settings_page.schema import schema
    from hri_predict.run.starting import SlowStart

    whole = schema()
    with SlowStart():
        text = _checked_text(
            path, answers, changes=change or [], whole=whole, with_schema=with_schema
        )
    write(path, text)
    written = [path]
    if with_schema:
        write(beside, json.dumps(whole, indent=1, ensure_ascii=False) + "\n")
        written.append(beside)
    tell(written)
    typer.echo(_next_steps(path, answers))


def _refuse_existing(path: Path, beside: Path | None, force: bool) -> None:
    """Fail before the first prompt.

    Raises:
        ConfigError: a file that the user may need would be overwritten.
    """
    # os.path takes names that are too long
    if os.path.isdir(path) or path.suffix not in YAML_ENDINGS:
        raise ConfigError(f"{path}: name a file that ends in .yaml")
    if len(os.fsencode(path.name)) > _LONGEST_NAME:
        raise ConfigError(f"{path}: its name is too long; choose a shorter one")
    if not os.path.isdir(path.parent):
        raise ConfigError(f"{path}: no folder {path.parent}; make it, or name another")
    if force:
        return
    if path.exists() or path.is_symlink():
        raise ConfigError(f"{path}: exists; name another file, or use --force to replace it")
    if beside is not None and beside.exists() and not _is_ours(beside):
        raise ConfigError(
            f"{beside}: already exists and was not written by hri-predict; use --force to "
            "replace it, or"
            " --no-schema"
        )


def _is_ours(beside: Path) -> bool:
    from hri_predict.cli.settings_page.schema import TITLE

    try:
        found = json.loads(beside.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(found, dict) and found.get("title") == TITLE


def _checked_text(
    path: Path,
    answers: Answers,
    *,
    changes: list[str],
    whole: dict[str, Any],
    with_schema: bool,
) -> str:
    """Return the file's text, which passes ``check``.

    Raises:
        HriPredictError: the answers are wrong; the message gives the reason.
    """
    from hri_predict.cli.check.check import examine
    from hri_predict.run.config import checked

    doors_m = list(DOORS_M)
    while True:
        data = cell(answers, path.parent, doors_m[0])
        for change in changes:
            set_key(data, change)
        text = _head(path, with_schema) + commented(data, hints(data), whole)
        try:
            examine(checked(path, text, load_yaml(text)))
        except ConfigError as error:
            if not (answers.simulated and "people.exits" in str(error) and len(doors_m) > 1):
                raise
            del doors_m[0]
        else:
            return text


def _head(path: Path, with_schema: bool) -> str:
    first = f"# yaml-language-server: $schema={SCHEMA_FILE}\n" if with_schema else ""
    return first + (
        f"# Written by hri-predict init. After each change: hri-predict check {_word(path.name)}\n"
        "# Poses are in the room's frame, z up; all keys: docs/configuration.md.\n\n"
    )


def _word(path: object) -> str:
    """Return a path quoted as one word for a shell, in one line."""
    return shlex.quote(str(path)).replace("\n", "?")


def _next_steps(path: Path, answers: Answers) -> str:
    file = _word(path)
    if answers.simulated:
        return f"next:\n  hri-predict run {file}   (Ctrl-C ends it)"
    return (
        "next: enter your own poses, then\n"
        f"  hri-predict check {file}\n"
        f"  hri-predict register {file}\n"
        f"  hri-predict run {file} --shadow"
    )


# -- a configuration as YAML text in which a comment says what each key is -------------------------

WIDTH = 80
_COLUMN = 30  # comments begin here, where there is room
_CHOICES = 6  # so many choices are listed; the rest is in the documents
_DEEP = 3  # blocks from this depth on stand in one line


def commented(data: dict[str, Any], hints: dict[str, Any], whole: Schema) -> str:
    """Return the text of ``data``, followed by ``hints``, optional keys as comments."""
    lines = list(_block(data, whole, whole, 0))
    if hints:
        lines += ["", "# Uncomment the keys that this cell needs, and enter its values:"]
        for line in _block(hints, whole, whole, 0):
            lines.append(f"# {line}" if line else "#")
    return "\n".join(lines).strip("\n") + "\n"


def _block(data: dict[str, Any], block: Schema, whole: Schema, depth: int) -> Iterator[str]:
    """Return the lines of a block of keys, indented by its depth."""
    for key, value in data.items():
        known = block.get("properties", {}).get(key, {})
        if depth == 0 and isinstance(value, dict | list):
            yield ""
        yield from _entry(key, value, known, whole, depth=depth)


def _entry(key: str, value: Any, known: Schema, whole: Schema, *, depth: int) -> Iterator[str]:
    indent = "  " * depth
    inner = _chosen(known, value, whole)
    said = phrase(key, known.get("description", ""))
    choices = inner.get("enum", [])
    if choices and len(choices) <= _CHOICES:
        said += f": {', '.join(map(str, choices))}"
    if isinstance(value, dict) and not _is_short(value, depth):
        yield from _said(f"{indent}{key}:", said, indent)
        yield from _block(value, inner, whole, depth + 1)
    elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
        yield from _said(f"{indent}{key}:", said, indent)
        for item in value:
            yield from _item(item, _chosen(inner.get("items", {}), item, whole), whole, depth + 1)
    else:
        yield from _said(f"{indent}{key}: {_flow(value)}", said, indent)


def _item(item: dict[str, Any], known: Schema, whole: Schema, depth: int) -> Iterator[str]:
    """Return an entry of a list, with its first key after the dash."""
    indent = "  " * depth
    if _is_short(item, depth):
        yield f"{indent}- {_flow(item)}"
        return
    lines = list(_block(item, known, whole, depth + 1))
    first = next(i for i, line in enumerate(lines) if not line.lstrip().startswith("#"))
    for i, line in enumerate(lines):
        yield f"{indent}- {line.lstrip()}" if i == first else line


def _said(line: str, said: str, indent: str) -> list[str]:
    """Return a line with its comment: at its end if both fit, otherwise above it."""
    if not said:
        return [line]
    padded = line.ljust(_COLUMN - 2)
    if len(padded) + len(said) + 4 <= WIDTH:
        return [f"{padded}  # {said}"]
    return [
        *textwrap.wrap(said, WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# "),
        line,
    ]


def _is_short(value: dict[str, Any], depth: int) -> bool:
    """Whether a block fits one line: a pose, a single key, or a deeply nested block."""
    alone = depth > 0 and len(value) == 1
    return depth >= _DEEP or alone or "xyz" in value or "polygon" in value


def _flow(value: Any) -> str:
    """Return a value in one line."""
    text = yaml.safe_dump(value, default_flow_style=True, width=10_000, sort_keys=False)
    return text.removesuffix("...\n").strip()


def _chosen(known: Schema, value: Any, whole: Schema) -> Schema:
    """Return the schema of this value, with references and unions resolved."""
    if "$ref" in known:
        return _chosen(whole["$defs"][known["$ref"].rsplit("/", 1)[-1]], value, whole)
    members = [_chosen(m, value, whole) for m in (*known.get("oneOf", []), *known.get("anyOf", []))]
    if not members:
        return known
    return next((member for member in members if _fits(member, value)), {})


def _fits(member: Schema, value: Any) -> bool:
    if not isinstance(value, dict):
        return member.get("type") != "null" and "properties" not in member
    keys = member.get("properties", {})
    named = all(value.get(k, v["const"]) == v["const"] for k, v in keys.items() if "const" in v)
    return bool(keys) and named
