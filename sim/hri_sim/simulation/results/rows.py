"""Checks that the rows of a finished block are those of its episodes.

A checksum only proves that a line is what some program wrote. Rows of something else would end the
simulation after hours, or go into its tables.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from pydantic import TypeAdapter, ValidationError

from hri_sim.simulation.results.outcome import Outcome, Prediction

MOST = 1e9
"""Maximum magnitude of a number in a row; counts, seconds and metres stay far below."""
_KINDS = {"outcomes": Outcome, "predictions": Prediction}
_TYPES: dict[str, TypeAdapter[Any]] = {name: TypeAdapter(kind) for name, kind in _KINDS.items()}


def are_of(rows: Mapping[str, Any], episodes: Sequence[int], variants: Sequence[str]) -> bool:
    """Return whether ``rows`` hold one outcome of each variant and one prediction per episode."""
    if set(rows) != {"outcomes", "predictions", "checks"}:
        return False
    if not all(isinstance(rows[key], list) for key in rows):
        return False
    wanted = sorted((index, name) for index in episodes for name in variants)
    if not all(_fits("outcomes", row, more={"variant"}) for row in rows["outcomes"]):
        return False
    if sorted((row["index"], row["variant"]) for row in rows["outcomes"]) != wanted:
        return False
    if not all(_fits("predictions", row, more=()) for row in rows["predictions"]):
        return False
    if sorted(row["index"] for row in rows["predictions"]) != sorted(episodes):
        return False
    return all(_is_check(row, episodes, variants) for row in rows["checks"])


def _fits(kind: str, row: Any, more: Iterable[str]) -> bool:
    names = {each.name for each in fields(_KINDS[kind])}
    if not isinstance(row, dict) or set(row) != names | set(more):
        return False
    if not all(isinstance(row[key], str) for key in more):
        return False
    try:
        _TYPES[kind].validate_json(json.dumps({name: row[name] for name in names}), strict=True)
    except ValidationError:
        return False
    return all(_is_sound(value) for value in row.values())


def _is_sound(value: Any) -> bool:
    if isinstance(value, list | dict):
        return all(map(_is_sound, value.values() if isinstance(value, dict) else value))
    return not isinstance(value, int | float) or -MOST <= value <= MOST


def _is_check(row: Any, episodes: Sequence[int], variants: Sequence[str]) -> bool:
    return (
        isinstance(row, dict)
        and set(row) == {"index", "variant", "disagreement"}
        and row["index"] in episodes
        and row["variant"] in variants
        and isinstance(row["disagreement"], str)
    )
