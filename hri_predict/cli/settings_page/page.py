"""``docs/configuration.md``: every key of a configuration, written from its JSON schema."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from hri_predict.base.quantities.units import unit_of
from hri_predict.cli.settings_page.schema import NAMED_BY, Schema, schema

HEAD = """\
# Configuration

All keys of a cell's YAML file, by block. `hri-predict config document` writes this
page from the descriptions in the code; change them there.

- `hri-predict init cell.yaml` writes a first configuration.
- `hri-predict check cell.yaml` reports file, line and remedy of each mistake.
- `hri-predict config schema` prints the same as a JSON schema, with the parts registered by other
  packages. Editors use it to complete keys and to mark mistakes.

Lengths are metres, times are seconds, angles are radians. Unknown keys are refused. `[]` is an
entry of a list. Relative paths start from the folder of the YAML file.
"""


def page() -> str:
    """Return the whole page, for this package's own parts.

    Raises:
        ConfigError: a part cannot be loaded because its package is not installed.
    """
    whole = schema(ours_only=True)
    sections = _sections(whole)
    names = {name: section.title for name, section in sections.items()}
    return HEAD + "".join(section.text(names, whole) for section in sections.values())


@dataclass
class _Section:
    """One block of keys.

    Attributes:
        places: keys that may have it as their value, such as ``robots[].motion``.
        kind: the name that selects it among the alternatives.
        block: its schema.
        common: keys that it shares with other blocks of its kind, and where they are described.
    """

    places: list[str]
    kind: str
    block: Schema
    common: dict[str, Any] = field(default_factory=dict)
    common_title: str = ""

    @property
    def title(self) -> str:
        if not self.places[0]:
            return "Top level"
        if self.kind:
            return f"`{self.places[0]}`: {self.kind}"
        return f"`{self.places[0]}`" if len(set(self.places)) == 1 else self._words()

    def _words(self) -> str:
        """Readable name of a model used by several keys."""
        name = self.block["title"]
        for end in ("Settings", "File", "Mode"):
            name = name.removesuffix(end)
        return "".join(f" {c.lower()}" if c.isupper() else c for c in name).strip().capitalize()

    def text(self, names: dict[str, str], whole: Schema) -> str:
        said = " ".join(self.block.get("description", "").split("\n\n")[0].split())
        lines = [f"\n## {self.title}\n"]
        said = said.replace("``", "`")
        if said and self.places[0] and not said.endswith(f"{self.kind or '-'}."):
            lines += [said + "\n"]
        if len(set(self.places)) > 1:
            lines += ["At: " + ", ".join(f"`{p}`" for p in dict.fromkeys(self.places)) + ".\n"]
        if self.common:
            lines += [f"The keys of [{self.common_title}](#{_anchor(self.common_title)}), and:\n"]
        rows = list(self._rows(names, whole))
        if rows:
            lines += ["| key | type | default | unit | |", "|---|---|---|---|---|", *rows]
        return "\n".join(lines) + "\n"

    def _rows(self, names: dict[str, str], whole: Schema) -> Iterator[str]:
        prefix = f"{self.places[0]}." if self.places[0] and len(set(self.places)) == 1 else ""
        for key, value in self.block["properties"].items():
            if self.common.get(key) == value:
                continue
            needed = key in self.block.get("required", []) and "const" not in value
            default = "**required**" if needed else _default(value)
            cells = [
                f"`{prefix}{key}`",
                _type(value, names),
                default,
                unit_of(key),
                " ".join(value.get("description", "").split()),
            ]
            yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _sections(whole: Schema) -> dict[str, _Section]:
    """Return the blocks by definition name, in the order in which keys refer to them."""
    top = {k: v for k, v in whole.items() if k != "$defs"}
    found = {"": _Section([""], "", top)}
    waiting = [("", "")]
    while waiting:
        name, place = waiting.pop(0)
        for key, value in found[name].block["properties"].items():
            at = f"{place}.{key}" if place else key
            for inner, where in _inner(value, at):
                if inner in found:
                    found[inner].places.append(where)
                    continue
                block = _block(whole["$defs"][inner])
                found[inner] = _Section([where], _kind(block), block)
                waiting.append((inner, where))
    for group in NAMED_BY:
        _share(found, group)
    return dict(sorted(found.items(), key=lambda item: _order(top, item[1])))


def _order(top: Schema, section: _Section) -> tuple[int, str, str]:
    """Return the blocks in the order of the top-level keys; blocks used in several places last."""
    if not section.places[0]:
        return -1, "", ""
    keys = list(top["properties"])
    first = section.places[0].split(".")[0].removesuffix("[]")
    several = len(set(section.places)) > 1
    return (len(keys) if several else keys.index(first)), section.places[0], section.kind


def _share(found: dict[str, _Section], group: str) -> None:
    """Describe keys common to all members of a union only once."""
    members = {name: s for name, s in found.items() if name.startswith(f"{group}.")}
    blocks = [section.block["properties"] for section in members.values()]
    alike = {k: v for k, v in blocks[0].items() if all(b.get(k) == v for b in blocks)}
    place = next(iter(members.values())).places[0]
    required = [k for k in alike if all(k in s.block["required"] for s in members.values())]
    shared = _Section([place], "", {"properties": alike, "required": required})
    shared.block["description"] = f"Every kind has these keys, besides `{NAMED_BY[group]}`."  # type: ignore[index]
    found[f"{group}:all"] = shared
    for section in members.values():
        section.common, section.common_title = alike, shared.title


def _block(definition: Schema) -> Schema:
    """Return the block itself if a string is allowed instead of it."""
    return next((m for m in definition.get("anyOf", []) if "properties" in m), definition)


def _kind(block: Schema) -> str:
    """Return ``kind: udp`` if a key with a single value selects this block."""
    chosen = ((k, v["const"]) for k, v in block["properties"].items() if "const" in v)
    return next((f"`{key}: {value}`" for key, value in chosen), "")


def _inner(value: Any, place: str) -> Iterator[tuple[str, str]]:
    """Return the definitions that a key's value refers to, and their places."""
    if "$ref" in value:
        yield _name(value), place
    for way in ("anyOf", "oneOf", "allOf"):
        for member in value.get(way, []):
            yield from _inner(member, place)
    if isinstance(value.get("items"), dict):
        yield from _inner(value["items"], f"{place}[]")
    if isinstance(value.get("additionalProperties"), dict):
        yield from _inner(value["additionalProperties"], f"{place}.*")


def _type(value: Schema, names: dict[str, str]) -> str:
    """Return the allowed values, in words."""
    if "$ref" in value:
        title = names[_name(value)]
        return f"[{title}](#{_anchor(title)})"
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{_yaml(each)}`" for each in value["enum"])
    for way in ("oneOf", "anyOf", "allOf"):
        if way in value:
            members = [m for m in value[way] if m.get("type") != "null"]
            if len(members) > 1 and all("$ref" in m for m in members):
                return _choice([names[_name(m)] for m in members])
            return " or ".join(dict.fromkeys(_type(m, names) for m in members))
    kind = value.get("type", "")
    if kind == "array":
        inner = _type(value.get("items", {}), names) or "values"
        return (
            f"list of {_count(value)}{inner}" if not inner.startswith("by ") else f"list, {inner}"
        )
    if kind == "object":
        values = value.get("additionalProperties")
        return (
            f"keys with {_type(values, names)}" if isinstance(values, dict) else "keys and values"
        )
    word = {
        "string": "text",
        "integer": "whole number",
        "number": "number",
        "boolean": "`true`, `false`",
    }.get(kind if isinstance(kind, str) else "string", "")
    return word + _limits(value)


def _name(reference: Schema) -> str:
    name: str = reference["$ref"].rsplit("/", 1)[-1]
    return name


def _choice(titles: list[str]) -> str:
    """Describe a union by its selecting key: ``kind``: ``udp``, ``json``, each with its link."""
    chosen = [title.rsplit("`: `", 1)[-1].rstrip("`").partition(": ") for title in titles]
    links = (f"[`{c[2]}`](#{_anchor(t)})" for c, t in zip(chosen, titles, strict=True))
    return f"by `{chosen[0][0]}`: {', '.join(links)}"


def _count(value: Schema) -> str:
    least, most = value.get("minItems"), value.get("maxItems")
    return f"{least}: " if least is not None and least == most else ""


def _limits(value: Schema) -> str:
    low, high = value.get("minimum"), value.get("maximum")
    above, below = value.get("exclusiveMinimum"), value.get("exclusiveMaximum")
    said = []
    if low is not None and high is not None:
        return f", {_yaml(low)} to {_yaml(high)}"
    if above is not None:
        said.append(f"above {_yaml(above)}")
    if low is not None:
        said.append(f"{_yaml(low)} or more")
    if below is not None:
        said.append(f"below {_yaml(below)}")
    if high is not None:
        said.append(f"up to {_yaml(high)}")
    return ", " + ", ".join(said) if said else ""


def _default(value: Schema) -> str:
    given = value.get("default")
    if given is None or "const" in value:
        return ""
    text = f"`{_yaml(given)}`"
    return text if len(text) <= 50 else "see there"


def _yaml(value: Any) -> str:
    """Return a value as YAML."""
    if isinstance(value, float):
        return f"{value:g}"
    return value if isinstance(value, str) else json.dumps(value)


def _anchor(title: str) -> str:
    """Return a heading's anchor, as generated by the site and code hosts."""
    kept = "".join(c for c in title.lower() if c.isalnum() or c in "_- ")
    return kept.strip().replace(" ", "-")
