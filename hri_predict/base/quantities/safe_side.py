"""Declaration of the direction in which each setting becomes less safe than its default.

A settings model declares it for every number and switch (``safety``), and a test finds missing
declarations. ``hri-predict check`` reports each setting on the less safe side, with its effect; the
commissioning report lists them for signature.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined


@dataclass(frozen=True, slots=True)
class LessSafe:
    """Effect of values on the less safe side of the default.

    The texts may use ``{value}``, ``{default}`` and ``{more}``, their difference; with ``:g``.

    Attributes:
        above, below: effect of a larger or smaller number; ``""``: that side is equally safe.
        other: effect of any other value, for a setting that is not a number.
    """

    above: str = ""
    below: str = ""
    other: str = ""


HARMLESS = LessSafe()
"""A setting without a less safe side: it describes a link, only adds protection, or has no effect
alone.
"""
Safety = Mapping[str, LessSafe]


def harmless(*keys: str) -> dict[str, LessSafe]:
    """Declaration for settings without a less safe side."""
    return dict.fromkeys(keys, HARMLESS)


@dataclass(frozen=True, slots=True)
class LessSafeSetting:
    """A setting on the less safe side of its default."""

    key: str
    value: str
    default: str
    permits: str

    def __str__(self) -> str:
        return f"{self.key}: {self.value} (default {self.default}): {self.permits}"


def declared(model: type, key: str) -> LessSafe | None:
    """Return the declaration of the model or its bases for a key; ``None`` if there is none."""
    for each in model.__mro__:
        found: Safety = each.__dict__.get("safety", {})
        if key in found:
            return found[key]
    return None


def less_safe(
    settings: BaseModel,
    at: str,
    computed: Mapping[str, float],
    reference: BaseModel | None = None,
) -> Iterator[LessSafeSetting]:
    """Return the settings less safe than their defaults, in a block and all nested blocks.

    Args:
        settings: the validated block.
        at: its key in the configuration.
        computed: defaults that depend on other settings, by key.
        reference: block with the default values; ``None``: the model's defaults.
    """
    for name, field in type(settings).model_fields.items():
        key, value = f"{at}.{name}", getattr(settings, name)
        if reference is None:
            default = None if field.default is PydanticUndefined else field.default
            has_default = field.default is not PydanticUndefined or key in computed
        else:
            default, has_default = getattr(reference, name), True
        default = computed.get(key, default)
        mark = declared(type(settings), name)
        if mark is not None and has_default and value is not None:
            yield from _judged(key, value, default, mark)
        yield from _inside(key, value, default, computed)


def _inside(
    key: str, value: Any, default: Any, computed: Mapping[str, float]
) -> Iterator[LessSafeSetting]:
    if isinstance(value, BaseModel):
        same = default if type(default) is type(value) else None
        yield from less_safe(value, key, computed, same)
    elif isinstance(value, dict):
        for name, each in value.items():
            there = default.get(name) if isinstance(default, dict) else None
            yield from _inside(f"{key}.{name}", each, there, computed)
    elif isinstance(value, list):
        for i, each in enumerate(value):
            yield from _inside(f"{key}.{i}", each, None, computed)


def _judged(key: str, value: Any, default: Any, mark: LessSafe) -> Iterator[LessSafeSetting]:
    if value == default:
        return
    numbers = [v for v in (value, default) if isinstance(v, int | float) and type(v) is not bool]
    if len(numbers) == 2:
        permits = mark.above if value > default else mark.below
        more = abs(value - default)
    else:
        permits, more = mark.other, 0.0
    if permits:
        said = permits.format(value=value, default=default, more=more)
        yield LessSafeSetting(key, shown(value), shown(default), said)


def shown(value: Any) -> str:
    """Return a value as short text; for regions, their extent on the floor."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float | int):
        return f"{value:.4g}"
    if value is None or value == []:
        return "none"
    if isinstance(value, list):
        return ", ".join(shown(each) for each in value)
    polygon = getattr(value, "polygon", None)
    if polygon is not None:
        width, depth = (max(each) - min(each) for each in zip(*polygon, strict=True))
        return f"{width:.1f} x {depth:.1f} m"
    return "set" if isinstance(value, BaseModel) else str(value)
