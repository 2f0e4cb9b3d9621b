"""Validated settings: the base of all configuration models, and validation of YAML data.

Each source, predictor, robot and link has its own model beside its code, derived from ``Settings``.
"""

import itertools
import math
import reprlib
from typing import Annotated, Any, Self, TypeVar

import numpy as np
import yaml
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    ValidationError,
    field_validator,
    model_validator,
)

from hri_predict.arrays import Floats
from hri_predict.errors import ConfigError, nearest
from hri_predict.files import load_yaml
from hri_predict.geometry import is_in_polygon


class Settings(BaseModel):
    """Base of every settings model: unknown keys are refused, values are immutable and finite.

    Truth is no number: YAML reads ``yes`` as true, and pydantic would take that for 1.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True
    )

    @model_validator(mode="wrap")
    @classmethod
    def _truth_is_no_number(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        result = handler(data)
        for key in data if isinstance(data, dict) else ():
            if _took_truth_for_a_number(data[key], getattr(result, key, None)):
                raise ValueError(f"{key}: true and false (yes, no, on, off in YAML) are no numbers")
        return result


def _took_truth_for_a_number(given: Any, taken: Any) -> bool:
    if isinstance(given, bool):
        return isinstance(taken, int | float) and not isinstance(taken, bool)
    if isinstance(given, dict) and isinstance(taken, dict):
        return any(_took_truth_for_a_number(given.get(key), taken[key]) for key in taken)
    if isinstance(given, list | tuple) and isinstance(taken, list | tuple):
        return any(map(_took_truth_for_a_number, given, taken))
    return False


S = TypeVar("S", bound=Settings)

MIN_RATE_HZ, MAX_RATE_HZ = 0.1, 10_000.0  # of a source of scenes
MAX_COORDINATE_M = 1000.0
Metres = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
"""A coordinate. No cell is a kilometre away from its origin, and with such limits products of
coordinates stay accurate."""
Vector3 = Annotated[list[Metres], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[float], Field(min_length=4, max_length=4)]
Point = Annotated[list[Metres], Field(min_length=2, max_length=2)]


class Pose(Settings):
    """A rigid pose (REP-103): ``xyz`` metres, ``quaternion_xyzw`` a unit quaternion."""

    xyz: Vector3 = [0.0, 0.0, 0.0]
    quaternion_xyzw: Quaternion = [0.0, 0.0, 0.0, 1.0]

    @field_validator("quaternion_xyzw")
    @classmethod
    def _unit(cls, value: list[float]) -> list[float]:
        norm = math.hypot(*value)
        if abs(norm - 1.0) > 0.01:
            raise ValueError(f"must be a unit quaternion [x, y, z, w]; its length is {norm:.3g}")
        return [v / norm for v in value]

    def matrix(self) -> Floats:
        """(4, 4) homogeneous transform."""
        x, y, z, w = self.quaternion_xyzw
        transform = np.eye(4)
        transform[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        transform[:3, 3] = self.xyz
        return transform


class Region(Settings):
    """A prism: a polygon on the floor between two heights, room frame, metres."""

    polygon: Annotated[list[Point], Field(min_length=3)]
    z_min: Metres = 0.0
    z_max: Metres = 3.0

    @model_validator(mode="after")
    def _has_volume(self) -> Self:
        if not self.z_max > self.z_min:
            raise ValueError("z_max must be above z_min")
        xy = np.asarray(self.polygon)
        area = 0.5 * float(
            np.sum(xy[:, 0] * np.roll(xy[:, 1], -1) - np.roll(xy[:, 0], -1) * xy[:, 1])
        )
        if abs(area) < 1e-6:
            raise ValueError("polygon has no area; give its corners in order")
        if _crosses_itself(self.polygon):
            raise ValueError("polygon crosses itself; give its corners in order")
        return self

    def contains(self, point: Floats) -> bool:
        """Whether ``point`` (3,) lies in the prism."""
        x, y, z = point.tolist()
        return self.z_min <= z <= self.z_max and is_in_polygon(x, y, self.polygon)


def _crosses_itself(polygon: list[Point]) -> bool:
    """Whether two edges cross at a point inside both: what is inside would not be what is meant."""

    def side(a: Point, b: Point, c: Point) -> float:
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    edges = list(zip(polygon, [*polygon[1:], polygon[0]], strict=True))
    return any(
        side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
        for (a, b), (c, d) in itertools.combinations(edges, 2)
    )


def validated(model: type[S], data: Any, where: str) -> S:
    """Validate ``data`` against ``model``; ``where`` names the file and key it came from.

    Raises:
        ConfigError: one line naming the first wrong key and the remedy.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        path = ".".join(str(part) for part in first["loc"])
        at = f"{where}: {path}" if path else where
        if first["type"] == "extra_forbidden":
            known = _keys_at(model, first["loc"][:-1])
            key = str(first["loc"][-1])
            raise ConfigError(
                f"{at}: unknown key{nearest(key, known)} (known: {', '.join(known)})"
            ) from None
        if first["type"] == "missing":
            raise ConfigError(f"{at}: required key is missing; add it") from None
        message = first["msg"].removeprefix("Value error, ")
        message = message[0].lower() + message[1:]
        if isinstance(
            first["input"], dict
        ):  # the error concerns the whole block; its value adds nothing
            raise ConfigError(f"{at}: {message}") from None
        raise ConfigError(f"{at}: {message}; got {_echo(first['input'])}") from None


def set_key(data: dict[str, Any], change: str) -> None:
    """Set one ``key.key=value`` of the command line, its value written as in YAML.

    Raises:
        ConfigError: it is not written so; one line with the remedy.
    """
    keys, equals, text = change.partition("=")
    path = keys.strip().split(".")
    if not equals or not all(path):
        raise ConfigError(f"--set {change}: write it as key=value, such as train.epochs=20")
    try:
        value = load_yaml(text)
    except (yaml.YAMLError, RecursionError) as error:
        raise ConfigError(f"--set {change}: its value is not valid YAML; quote it") from error
    at = data
    for key in path[:-1]:
        at = at.setdefault(key, {})
        if not isinstance(at, dict):
            raise ConfigError(f"--set {change}: '{key}' has no keys; see the configuration")
    at[path[-1]] = value


def _echo(value: Any) -> str:
    """A wrong value as short text, limited in depth and width."""
    try:
        got = reprlib.repr(value)
    except ValueError:  # an integer of thousands of digits has no decimal text
        got = type(value).__name__
    return got if len(got) < 60 else got[:57] + "..."


def _keys_at(model: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    """Keys of the model nested in ``model`` at ``loc``, to name the nearest one."""
    current: type[BaseModel] = model
    for part in loc:
        if isinstance(part, int):
            continue
        field = current.model_fields.get(part)
        if field is None:  # a union's tag
            continue
        for candidate in _models_in(field.annotation):
            current = candidate
            break
    return sorted(current.model_fields)


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for part in getattr(annotation, "__args__", ()) for m in _models_in(part)]
