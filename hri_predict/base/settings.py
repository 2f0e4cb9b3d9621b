"""Validated settings: the base of all configuration models, and validation of YAML data.

Each source, predictor, robot and link has its own model, derived from ``Settings``.
"""

import math
import reprlib
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date
from typing import Annotated, Any, ClassVar, Self, TypeVar, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, ErrorDetails

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import QUARTER, TURNED, ConfigError, expected_shape, nearest
from hri_predict.base.geometry import crosses_itself, is_in_polygon, rotation_of
from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.base.quantities.units import meant, phrase, unit_at


class Settings(BaseModel):
    """Base of every settings model: unknown keys are refused, values are immutable and finite.

    A boolean is not a number: YAML reads ``yes`` as true, and pydantic would accept it as 1.

    Attributes:
        safety: by key, the side on which a value is less safe than the default (``safe_side``).
    """

    safety: ClassVar[Safety] = {}

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        validate_default=True,
        defer_build=True,  # a model within another one is built with it, and most are not used
    )

    @model_validator(mode="wrap")
    @classmethod
    def _truth_is_no_number(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        result = handler(data)
        for key in data if isinstance(data, dict) else ():
            if _took_truth_for_a_number(data[key], getattr(result, key, None)):
                raise ValueError(
                    f"{key}: true and false (yes, no, on, off in YAML) are not numbers"
                )
        return result


class Abbreviated(Settings):
    """A block that may be written as a single text, the value of its first key."""

    @model_validator(mode="before")
    @classmethod
    def _one_text(cls, data: Any) -> Any:
        first = next(iter(cls.model_fields))
        if not isinstance(data, str | dict | cls):
            raise ValueError(f"give a string, which is its '{first}', or keys and values")
        return {first: data} if isinstance(data, str) else data

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        reference = handler(core_schema)
        found = handler.resolve_ref_schema(reference)
        block = dict(found)
        found.clear()
        found |= {"anyOf": [{"type": "string", "minLength": 1}, block]}
        return reference


def _took_truth_for_a_number(given: Any, taken: Any) -> bool:
    if isinstance(given, bool):
        return isinstance(taken, int | float) and not isinstance(taken, bool)
    if isinstance(given, dict) and isinstance(taken, dict):
        return any(_took_truth_for_a_number(given.get(key), taken[key]) for key in taken)
    if isinstance(given, list | tuple) and isinstance(taken, list | tuple):
        pairs = zip(given, taken, strict=False)
        # long tables hold plain numbers
        return any(type(g) not in (float, int) and _took_truth_for_a_number(g, t) for g, t in pairs)
    return False


S = TypeVar("S", bound=Settings)

MIN_RATE_HZ, MAX_RATE_HZ = 0.1, 10_000.0  # of a source of scenes
MAX_COORDINATE_M = 1000.0
"""Maximum coordinate from a source; it keeps products of coordinates accurate."""
MAX_ROOM_M = 100.0
"""Maximum coordinate in a configuration; a larger value was written in another unit."""
MIN_SPEED_M_S = 0.01
"""Minimum configurable speed: ISO 10218-1 has 0.25 m/s as reduced speed, and motion below 1 mm/s is
treated as standing (``robots.stopping``).
"""
MIN_HUMAN_M_S = 1.2
"""Minimum assumed speed of a person: the comfortable walking speed of adults is 1.2 to 1.4 m/s (R.
Bohannon, Age and Ageing 26 (1997) 15). ISO 13855 uses 1.6 m/s for all people.
"""
MAX_PAYLOAD_KG = 5000.0
"""Maximum payload: the strongest commercial arms carry 2.3 t (FANUC M-2000iA/2300)."""
MAX_ANGLE_RAD = 2 * math.pi
"""Maximum of a fixed angle; larger values are reported as probable degrees."""
Radians = Annotated[float, Field(ge=-MAX_ANGLE_RAD, le=MAX_ANGLE_RAD)]
"""Angle of a part that does not rotate."""
Metres = Annotated[float, Field(ge=-MAX_ROOM_M, le=MAX_ROOM_M)]
"""A coordinate of a configuration."""
MIN_SIDE_M = 0.01
"""Minimum size of a region: trackers cannot decide whether a person is in a smaller one."""
Vector3 = Annotated[list[Metres], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[float], Field(min_length=4, max_length=4)]
Point = Annotated[list[Metres], Field(min_length=2, max_length=2)]


MAX_NAME, MAX_NAME_BYTES = 64, 128  # file names have 255 bytes in all


def name_problem(name: str) -> str | None:
    """Return why ``name`` is not allowed, with the remedy; ``None`` if it is allowed.

    Names occur in file names, topics, keys, labels and pages, and are read aloud. So they consist
    of letters and digits of any language, and of separators without a special meaning in any of
    these.
    """
    if len(name) > MAX_NAME or len(name.encode("utf-8", "replace")) > MAX_NAME_BYTES:
        return f"a name has at most {MAX_NAME} characters and {MAX_NAME_BYTES} bytes; shorten it"
    ends = name[:1] + name[-1:]
    plain = all(c in " _-.()" or unicodedata.category(c)[0] in "LMN" for c in name)
    if not plain or not ends or ends[0] in " -." or ends[-1] in " .":
        return (
            "a name has letters, digits, spaces and _ - . ( ), and begins with a letter or digit; "
            "choose another name"
        )
    return None


def _named(value: str) -> str:
    if problem := name_problem(value):
        raise ValueError(problem)
    return value


Name = Annotated[str, Field(min_length=1, max_length=MAX_NAME), AfterValidator(_named)]
"""User-defined name of a robot, tool, zone or link; see ``name_problem``."""


class Pose(Settings):
    """A rigid pose (REP-103): ``xyz`` in metres, ``quaternion_xyzw`` a unit quaternion."""

    xyz: Vector3 = Field([0.0, 0.0, 0.0], description="position of its origin, m")
    quaternion_xyzw: Quaternion = Field(
        [0.0, 0.0, 0.0, 1.0], description="orientation: a unit quaternion [x, y, z, w]"
    )

    @field_validator("quaternion_xyzw")
    @classmethod
    def _unit(cls, value: list[float]) -> list[float]:
        norm = math.hypot(*value)
        if abs(norm - 1.0) > 0.01:
            raise ValueError(f"must be a unit quaternion [x, y, z, w]; its length is {norm:.3g}")
        return [v / norm for v in value]

    def matrix(self) -> Floats:
        """(4, 4) homogeneous transform."""
        transform = np.eye(4)
        transform[:3, :3] = rotation_of(self.quaternion_xyzw)
        transform[:3, 3] = self.xyz
        return transform


class Region(Settings):
    """A prism: a polygon on the floor between two heights, room frame, metres."""

    polygon: Annotated[list[Point], Field(min_length=3)] = Field(
        description="corners on the floor in order, [x, y] each, m"
    )
    z_min: Metres = Field(0.0, description="height of the lower end, m")
    z_max: Metres = Field(3.0, description="height of the upper end, m")

    safety: ClassVar[Safety] = harmless("z_min", "z_max")

    @model_validator(mode="after")
    def _has_volume(self) -> Self:
        if not self.z_max >= self.z_min + MIN_SIDE_M:
            raise ValueError(f"z_max must be above z_min, by {MIN_SIDE_M:g} m at least")
        xy = np.asarray(self.polygon)
        area = 0.5 * float(
            np.sum(xy[:, 0] * np.roll(xy[:, 1], -1) - np.roll(xy[:, 0], -1) * xy[:, 1])
        )
        if abs(area) < MIN_SIDE_M**2:
            raise ValueError("polygon has no area; give its corners in order, in metres")
        if crosses_itself(self.polygon):
            raise ValueError("polygon crosses itself; give its corners in order")
        return self

    def contains(self, point: Floats) -> bool:
        """Whether ``point`` (3,) lies in the prism."""
        x, y, z = point.tolist()
        return self.z_min <= z <= self.z_max and is_in_polygon(x, y, self.polygon)


def validated(model: type[S], data: Any, where: str) -> S:
    """Validate ``data`` against ``model``; ``where`` names the file and key it came from.

    Raises:
        ConfigError: one line naming the first wrong key and the remedy.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = mistakes(error, model, data)[0]
        at = ": ".join(part for part in (where, first.path) if part)
        raise ConfigError(f"{at}: {first.text}") from None


@dataclass(frozen=True, slots=True)
class Mistake:
    """A wrong key or value.

    Attributes:
        keys: its path in the data, such as ``("robots", 0, "name")``.
        text: what is wrong, and the remedy.
    """

    keys: tuple[str | int, ...]
    text: str

    @property
    def path(self) -> str:
        """The keys as written in messages: ``robots.0.name``."""
        return ".".join(map(str, self.keys))


def mistakes(error: ValidationError, model: type[BaseModel], data: Any) -> list[Mistake]:
    """Return all mistakes in ``data`` according to ``model``, in the order of the keys."""
    found: dict[tuple[str | int, ...], Mistake] = {}
    tried: set[tuple[str | int, ...]] = set()  # where other members of a union failed, too
    for each in error.errors():
        keys, member = _keys_of(each["loc"], data, each["type"] == "missing")
        if member and keys not in found:
            tried.add(keys)
        if keys not in found:
            found[keys] = Mistake(keys, _text(each, model))
    return [m for keys, m in found.items() if not (keys in tried and _has_more(keys, found))]


def _has_more(keys: tuple[str | int, ...], found: Iterable[tuple[str | int, ...]]) -> bool:
    return any(len(other) > len(keys) and other[: len(keys)] == keys for other in found)


def _keys_of(
    loc: tuple[int | str, ...], data: Any, missing: bool
) -> tuple[tuple[str | int, ...], bool]:
    """Return the keys of an error's location, and whether it ends with the name of a union's
    member.
    """
    keys: list[str | int] = []
    at = data
    for part in loc:
        if (isinstance(at, dict) and part in at) or (
            isinstance(at, list) and isinstance(part, int) and part < len(at)
        ):
            keys.append(part)
            at = at[part]  # type: ignore[index]
    if missing:
        keys.append(loc[-1])
    return tuple(keys), not missing and bool(loc) and (not keys or keys[-1] != loc[-1])


def _text(found: ErrorDetails, model: type[BaseModel]) -> str:
    """Return the problem at one location, the expected value, and the remedy."""
    loc = found["loc"]
    if found["type"] == "extra_forbidden":
        known = sorted({key for m in _models_at(model, loc[:-1]) for key in m.model_fields})
        meant = nearest(str(loc[-1]), known)
        example = f" {TURNED}: {QUARTER}" if "'quaternion_xyzw'" in meant else ""
        return f"unknown key{meant}{example} (known: {', '.join(known)})"
    about, unit = _about(model, loc)
    if found["type"] == "missing":
        return f"required key is missing; add it{about}"
    message = found["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    fields = {name: f for m in _models_at(model, loc) for name, f in m.model_fields.items()}
    keys = sorted(fields, key=lambda name: not fields[name].is_required())  # required first
    if (expected := expected_shape(found["type"], keys)) is not None:
        got = "nothing" if found["input"] is None else _echo(found["input"])
        return f"{expected}; got {got}{about}"
    if isinstance(found["input"], dict):  # of the whole block; its value adds nothing
        return message
    if found["type"] == "literal_error":
        message += nearest(str(found["input"]), found["ctx"]["expected"].split("'")[1::2])
    if found["type"] == "string_type" and isinstance(found["input"], bool | int | float | date):
        message += ", so put it in quotes"  # no, on, 12 and 2026-01-01 are no text in YAML
    return f"{message}; got {_echo(found['input'])}{about}{_hint(found, unit)}"


def _hint(found: ErrorDetails, unit: str) -> str:
    """Return a number beyond its maximum, converted to the right unit; empty for others."""
    greatest = found.get("ctx", {}).get("le")
    if found["type"] == "greater_than_equal":  # the other end of a range around 0
        greatest = -found["ctx"]["ge"] if found["ctx"]["ge"] < 0 else None
    if greatest is None or not isinstance(found["input"], int | float):
        return ""
    try:
        number = float(found["input"])
    except OverflowError:  # an integer beyond all floats, in no unit
        return ""
    hint = meant(number, unit, -greatest if number < 0 else -math.inf, greatest)
    return f"; {hint}" if hint else ""


def _about(model: type[BaseModel], loc: tuple[int | str, ...]) -> tuple[str, str]:
    """Return the key's description, in brackets, and its unit; empty if the field has none."""
    for end in range(len(loc), 0, -1):
        key = str(loc[end - 1])
        for owner in _models_at(model, loc[: end - 1]):
            field = owner.model_fields.get(key)
            if field is not None:
                said = field.description or ""
                return f" ({phrase(key, said)})" if said else "", unit_at(key, said)
    return "", ""


def _echo(value: Any) -> str:
    """Return a wrong value as short text, limited in depth and width."""
    try:
        got = reprlib.repr(value)
    except ValueError:  # an integer of thousands of digits has no decimal text
        got = type(value).__name__
    return got if len(got) < 60 else got[:57] + "..."


def _models_at(model: type[BaseModel], loc: tuple[int | str, ...]) -> list[type[BaseModel]]:
    """Return the models at ``loc`` within ``model``: several if it ends in a union."""
    found = [model]
    for part in loc:
        if isinstance(part, int):
            continue
        fields = [m.model_fields[part] for m in found if part in m.model_fields]
        if fields:
            found = [inner for field in fields for inner in models_in(field.annotation)]
        else:  # a union's tag, or a key of a mapping
            found = [m for m in found if m.__name__ == part or _is_tagged(m, part)] or found
    return found


def _is_tagged(model: type[BaseModel], tag: str) -> bool:
    """Whether a union's member matches ``tag``."""
    fields = model.model_fields.values()
    return any(get_args(field.annotation) == (tag,) for field in fields)


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """Return all models that occur in a field's type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for part in get_args(annotation) for m in models_in(part)]
