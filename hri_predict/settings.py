"""Validated settings: the base of every configuration model, and how YAML reaches it.

Each source, predictor, robot and link has its own model beside its code, derived from ``Settings``.
"""

import math
import os
import reprlib
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from hri_predict.errors import ConfigError, nearest
from hri_predict.named_pipe import refuse_named_pipe
from hri_predict.scene import Floats
from hri_predict.yaml_text import MAX_CHARACTERS, load_yaml


class Settings(BaseModel):
    """Base of every settings model: unknown keys are refused, values are immutable and finite."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True
    )


S = TypeVar("S", bound=Settings)

MIN_RATE_HZ, MAX_RATE_HZ = 0.1, 10_000.0  # of a source of scenes
MAX_COORDINATE_M = 1000.0
Metres = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
"""A coordinate: no cell is a kilometre from its origin, and products of such numbers stay exact."""
Vector3 = Annotated[list[Metres], Field(min_length=3, max_length=3)]
Point = Annotated[list[Metres], Field(min_length=2, max_length=2)]


class Pose(Settings):
    """A rigid pose (REP-103): ``xyz`` metres, ``quaternion_xyzw`` a unit quaternion."""

    xyz: Vector3 = [0.0, 0.0, 0.0]
    quaternion_xyzw: Annotated[list[float], Field(min_length=4, max_length=4)] = [
        0.0,
        0.0,
        0.0,
        1.0,
    ]

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
        return self


def transform(matrix: Floats, points: Floats) -> Floats:
    """Apply a (4, 4) transform to points (..., 3)."""
    result: Floats = points @ matrix[:3, :3].T + matrix[:3, 3]
    return result


def read_yaml(path: Path, what: str) -> dict[str, Any]:
    """Read a YAML mapping.

    Raises:
        ConfigError: the file is missing, unreadable, too long, not YAML (see ``load_yaml``), or not
            a mapping.
    """
    try:
        data = load_yaml(read_text(path, what))
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = getattr(error, "problem", None)
        why = f" ({problem})" if isinstance(problem, str) and problem else ""
        raise ConfigError(f"{what} {path}: not valid YAML{where}{why}; mend it there") from error
    if not isinstance(data, dict):
        found = "nothing" if data is None else type(data).__name__
        raise ConfigError(f"{what} {path}: expected keys and values, found {found}")
    return data


def read_text(path: Path, what: str) -> str:
    """Read a text file of the user's.

    Raises:
        ConfigError: the file is missing, unreadable, too long, or not UTF-8.
    """
    try:
        refuse_named_pipe(path)
        with path.open(encoding="utf-8") as file:
            text = file.read(MAX_CHARACTERS + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path, or not UTF-8
        reason = (error.strerror if isinstance(error, OSError) else None) or "it is not UTF-8 text"
        raise ConfigError(f"{what} {path}: cannot be read: {reason}; check the path") from error
    if len(text) > MAX_CHARACTERS:
        raise ConfigError(f"{what} {path}: longer than {MAX_CHARACTERS} characters; check the path")
    return text


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
        if isinstance(first["input"], dict):  # of the whole block, whose keys say nothing more
            raise ConfigError(f"{at}: {message}") from None
        raise ConfigError(f"{at}: {message}; got {_echo(first['input'])}") from None


def _echo(value: Any) -> str:
    """A wrong value, short: bounded in depth and width, whatever it is."""
    try:
        got = reprlib.repr(value)
    except ValueError:  # an integer of thousands of digits has no decimal text
        got = type(value).__name__
    return got if len(got) < 60 else got[:57] + "..."


def _keys_at(model: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    """Keys of the model nested in ``model`` at ``loc``, for naming the nearest."""
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


def data_path(*parts: str) -> Path:
    """Path of a file shipped under ``configs/``: the package's copy, else the checkout's."""
    here = Path(__file__).resolve().parent
    packaged = here.joinpath("configs", *parts)
    # os.path: a name that is too long is of no file, where Path.exists would raise
    return packaged if os.path.exists(packaged) else here.parent.joinpath("configs", *parts)
