"""The JSON schema of a whole configuration, merged from the settings models of all its parts.

The models are the only source. Registered parts form unions: sources and links by ``kind``,
predictors by ``name``. Editors use the schema to complete keys and to mark mistakes; it is slightly
stricter than the node (no numbers in quotes) and contains no rules between keys.
"""

from collections.abc import Iterable, Iterator
from copy import deepcopy
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue, models_json_schema
from pydantic_core import core_schema

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Settings
from hri_predict.contracts import registry
from hri_predict.run.config import NodeSettings

TITLE = "Configuration of hri-predict"
NAMED_BY: dict[registry.PartKind, str] = {"sources": "kind", "predictors": "name", "links": "kind"}

Schema = dict[str, Any]


class _Generate(GenerateJsonSchema):
    def str_schema(self, schema: core_schema.StringSchema) -> JsonSchemaValue:
        """Text, or a number that is read as text (channel: 0)."""
        found = super().str_schema(schema)
        if schema.get("coerce_numbers_to_str"):
            found["type"] = ["string", "number"]
        return found


def schema(*, ours_only: bool = False) -> Schema:
    """Return the JSON schema (draft 7) of a configuration.

    Args:
        ours_only: leave out the parts of third parties, for the page of the docs.

    Raises:
        ConfigError: a fault or a simulated controller cannot be loaded.
    """
    parts = {kind: dict(_parts(kind, ours_only)) for kind in NAMED_BY}
    source_faults = dict(registry.load("faults", "source").kinds)
    link_faults = dict(registry.load("faults", "link").kinds)
    controller = registry.load("cells", "mock").settings_model
    named = [model for found in parts.values() for model in found.values()]
    models = [NodeSettings, controller, *named, *source_faults.values(), *link_faults.values()]
    generated = [model for model in dict.fromkeys(models) if isinstance(model, type)]
    refs, whole = models_json_schema(
        [(model, "validation") for model in generated], schema_generator=_Generate
    )
    defs = whole["$defs"]
    own = {model: defs[refs[model, "validation"]["$ref"].rsplit("/", 1)[-1]] for model in generated}
    for model, block in own.items():
        _inherit_descriptions(model, block)

    merged = _Merged(own)
    unions = {kind: merged.union(kind, key, parts[kind]) for kind, key in NAMED_BY.items()}
    link_fault = merged.union("link_faults", "kind", link_faults)
    merged.defs["simulate"] = own[controller]
    merged.put(
        "sources.", "faults", {"items": merged.union("source_faults", "kind", source_faults)}
    )
    merged.put("links.", "faults", {"items": link_fault})
    merged.put("simulate", "faults", {"items": link_fault})
    merged.put("links.", "simulate", {"anyOf": [{"$ref": "#/$defs/simulate"}, {"type": "null"}]})
    top = own[NodeSettings]
    _put(top, "source", unions["sources"])
    _put(top, "predictor", unions["predictors"])
    _put(top, "links", {"items": unions["links"]})
    head = {"$schema": "http://json-schema.org/draft-07/schema#"}
    found = head | top | {"title": TITLE, "$defs": defs | merged.defs}
    return _only_used(found)


def _parts(kind: registry.PartKind, ours_only: bool) -> Iterator[tuple[str, type[Settings] | str]]:
    """Return the settings model of each registered part, or the reason why it cannot be loaded."""
    for name in registry.names(kind):
        if ours_only and not registry.is_ours(kind, name):
            continue
        try:
            yield name, registry.load(kind, name).settings_model
        except ConfigError as error:
            if ours_only:  # the page must be whole
                raise
            yield name, str(error)


class _Merged:
    """Definitions of parts by name, such as ``sources.udp``."""

    def __init__(self, own: dict[Any, Schema]) -> None:
        self._own = own
        self.defs: dict[str, Schema] = {}

    def union(self, what: str, key: str, models: dict[str, Any]) -> Schema:
        """Define every member of a union, and return the union."""
        for name, model in models.items():
            self.defs[f"{what}.{name}"] = self._member(key, name, model)
        return {
            "type": "object",
            "required": [key],
            "properties": {key: {"enum": list(models)}},
            "oneOf": [{"$ref": f"#/$defs/{what}.{name}"} for name in models],
        }

    def put(self, group: str, key: str, value: Schema) -> None:
        """As ``_put``, in every definition with ``key`` and a name that starts with ``group``."""
        for name, block in self.defs.items():
            if name.startswith(group) and key in block["properties"]:
                _put(block, key, value)

    def _member(self, key: str, name: str, model: type[Settings] | str) -> Schema:
        if isinstance(model, str):
            known: Schema = {"type": "object", "description": model, "properties": {}}
        else:
            known = deepcopy(self._own[model])
        about = known["properties"].get(key, {}).get("description", "")
        known["properties"] = {key: {"const": name, "description": about}} | {
            other: value for other, value in known["properties"].items() if other != key
        }
        known["required"] = [key, *(k for k in known.get("required", []) if k != key)]
        known["title"] = name
        return known


def _inherit_descriptions(model: type[Settings], block: Schema) -> None:
    """Inherit the description of a key that a model only narrows."""
    for key, value in block.get("properties", {}).items():
        fields = (getattr(base, "model_fields", {}).get(key) for base in model.__mro__)
        said = (field.description for field in fields if field is not None and field.description)
        if "description" not in value and (first := next(said, None)):
            value["description"] = first


def _put(block: Schema, key: str, value: Schema) -> None:
    """Refine the schema of a key that its model leaves open; description and default stay."""
    before = block["properties"][key]
    kept = {k: v for k, v in before.items() if k not in ("anyOf", "items", "additionalProperties")}
    block["properties"][key] = kept | value


def _only_used(whole: Schema) -> Schema:
    """Remove unused definitions, and sort the rest."""
    used: set[str] = set()
    waiting = list(_references({k: v for k, v in whole.items() if k != "$defs"}))
    while waiting:
        name = waiting.pop()
        if name not in used:
            used.add(name)
            waiting += _references(whole["$defs"][name])
    return whole | {"$defs": {name: whole["$defs"][name] for name in sorted(used)}}


def _references(value: Any) -> Iterator[str]:
    """Return the names of the definitions that a schema refers to."""
    if isinstance(value, dict):
        if isinstance(value.get("$ref"), str):
            yield value["$ref"].rsplit("/", 1)[-1]
        for inner in value.values():
            yield from _references(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _references(inner)


def undescribed(whole: Schema) -> Iterable[str]:
    """Return keys without a description, as ``definition.key``; a test rejects them."""
    blocks = {"": whole} | whole["$defs"]
    for name, block in blocks.items():
        for member in (block, *block.get("anyOf", [])):
            for key, value in member.get("properties", {}).items():
                if not value.get("description"):
                    yield f"{name}.{key}"
