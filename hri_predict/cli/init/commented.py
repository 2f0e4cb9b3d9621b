"""A configuration as YAML text in which a comment says what each key is.

The comments are the descriptions of the settings models, taken from the JSON schema.
"""

import textwrap
from collections.abc import Iterator
from typing import Any

import yaml

from hri_predict.base.quantities.units import phrase
from hri_predict.cli.settings_page.schema import Schema

WIDTH = 80
_COLUMN = 30  # comments begin here, where there is room
_CHOICES = 6  # so many choices are listed; the rest is in the documents
_DEEP = 3  # blocks from this depth on stand in one line


def commented(data: dict[str, Any], hints: dict[str, Any], whole: Schema) -> str:
    """The text of ``data``; after it ``hints``, keys that a user may want, as comments."""
    lines = list(_block(data, whole, whole, 0))
    if hints:
        lines += ["", "# Remove the # before what this cell has, and put in its values:"]
        for line in _block(hints, whole, whole, 0):
            lines.append(f"# {line}" if line else "#")
    return "\n".join(lines).strip("\n") + "\n"


def _block(data: dict[str, Any], block: Schema, whole: Schema, depth: int) -> Iterator[str]:
    """The lines of a block of keys, indented by its depth."""
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
    """An entry of a list: its first key stands behind the dash."""
    indent = "  " * depth
    if _is_short(item, depth):
        yield f"{indent}- {_flow(item)}"
        return
    lines = list(_block(item, known, whole, depth + 1))
    first = next(i for i, line in enumerate(lines) if not line.lstrip().startswith("#"))
    for i, line in enumerate(lines):
        yield f"{indent}- {line.lstrip()}" if i == first else line


def _said(line: str, said: str, indent: str) -> list[str]:
    """A line with its comment: behind it where both fit, otherwise above."""
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
    """Whether a block stands in one line: a pose, one key, or deep inside."""
    alone = depth > 0 and len(value) == 1
    return depth >= _DEEP or alone or "xyz" in value or "polygon" in value


def _flow(value: Any) -> str:
    """A value in one line."""
    text = yaml.safe_dump(value, default_flow_style=True, width=10_000, sort_keys=False)
    return text.removesuffix("...\n").strip()


def _chosen(known: Schema, value: Any, whole: Schema) -> Schema:
    """Return the schema of this value: references followed, the right member of a union."""
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
