"""Code common to all faults: settings, time window, command-line form."""

import re
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Generic, Literal, TypeVar

import numpy as np
import yaml
from pydantic import Field, model_validator

from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.files import load_yaml, yaml_problem
from hri_predict.base.settings import Settings, validated


class FaultSettings(Settings):
    """One fault: its kind, its start (after the run's) and its duration (``None``: to the end)."""

    soak: ClassVar[tuple[str, ...]] = ("",)
    """Parameter sets for the soak test, as on the command line; empty: never injected there."""
    deceives: ClassVar[bool] = False
    """Whether it invents people or positions; beyond 2 s the node has to accept those."""

    kind: str = Field(description="kind of fault")
    start_s: float = Field(0.0, ge=0, description="start, from the run's start")
    duration_s: float | None = Field(None, gt=0, description="duration; default: to the end")

    def active(self, elapsed_ns: int) -> bool:
        """Return whether the fault is active ``elapsed_ns`` after the start."""
        since_s = elapsed_ns * 1e-9 - self.start_s
        return since_s >= 0 and (self.duration_s is None or since_s < self.duration_s)

    @model_validator(mode="before")
    @classmethod
    def _is_mapping(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            raise ValueError("a fault is a mapping with a 'kind'")
        return data


F = TypeVar("F", bound=FaultSettings)
Target = Literal["source", "link"]


def fault_from(data: Any, kinds: Mapping[str, type[F]], where: str) -> F:
    """Validate one fault's settings against the model of its kind.

    Raises:
        ConfigError: unknown kind (the error lists the known ones), or a wrong key.
    """
    if not isinstance(data, Mapping) or not isinstance(data.get("kind"), str):
        raise ConfigError(f"{where}: a fault needs a 'kind'; available: {', '.join(sorted(kinds))}")
    kind = data["kind"]
    if kind not in kinds:
        raise ConfigError(
            f"{where}: unknown fault '{kind}'{nearest(kind, kinds)}; "
            f"available: {', '.join(sorted(kinds))}"
        )
    return validated(kinds[kind], dict(data), f"{where} ({kind})")


def faults_from(items: Sequence[Any], kinds: Mapping[str, type[F]], where: str) -> list[F]:
    """Validate a list of faults; see ``fault_from``."""
    return [fault_from(item, kinds, f"{where}.{i}") for i, item in enumerate(items)]


_FORM = re.compile(
    r"(?P<kind>[a-z_]+)(@(?P<start>[0-9.]+)(\+(?P<duration>[0-9.]+))?)?(:(?P<parameters>.+))?"
)
_COMMA = re.compile(r",(?![^\[]*\])")  # a comma, but not within brackets


def fault_mapping(text: str, kinds: Mapping[str, type[F]]) -> dict[str, Any]:
    """Parse ``kind[@start[+duration]][:parameter=value,...]``, such as ``vanish@3+2:person=0``.

    Returns:
        the settings as written in a configuration, validated.

    Raises:
        ConfigError: the form or the fault is wrong (see ``fault_from``).
    """
    where = f"fault '{text}'"
    form = "expected kind@start+duration in seconds, such as vanish@3+2 or delay@3+2:delay_s=0.2"
    match = _FORM.fullmatch(text.strip())
    if match is None:
        raise ConfigError(f"{where}: {form}")
    data: dict[str, Any] = {"kind": match["kind"]}
    try:
        if match["start"]:
            data["start_s"] = float(match["start"])
        if match["duration"]:
            data["duration_s"] = float(match["duration"])
        for pair in _COMMA.split(match["parameters"] or ""):
            if pair:
                name, equals, value = pair.partition("=")
                if not equals:
                    raise ConfigError(
                        f"{where}: parameter '{pair}' lacks a value; write name=value"
                    )
                name = name.strip()
                if name in ("kind", "start_s", "duration_s"):
                    raise ConfigError(
                        f"{where}: '{name}' is not a parameter; write it as kind@start+duration"
                    )
                if name in data:
                    raise ConfigError(f"{where}: parameter '{name}' is given twice; remove one")
                data[name] = load_yaml(value)
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        raise ConfigError(f"{where}: {form}{yaml_problem(error)}") from error
    fault_from(data, kinds, where)
    return data


# -- faults that sources and links share: what passes is lost, doubled, swapped or late ------------

T = TypeVar("T")


class Drop(FaultSettings):
    """Scenes are lost."""

    soak = ("", "probability=0.3")

    probability: float = Field(1.0, gt=0, le=1, description="chance that a scene is lost")


class Late(FaultSettings):
    """A fault that delays scenes or units."""

    def late_ns(self, elapsed_ns: int, rng: np.random.Generator) -> int:
        """Return the delay in ns of a scene or unit that passes ``elapsed_ns`` after the start."""
        raise NotImplementedError


class Delay(Late):
    """Scenes arrive late; their capture stamps are true."""

    delay_s: float = Field(0.2, gt=0, le=10, description="delay of every scene")

    def late_ns(self, elapsed_ns: int, rng: np.random.Generator) -> int:
        """Return the delay."""
        return int(self.delay_s * 1e9)


class Jitter(Late):
    """Scenes arrive late by a random time, still in order."""

    max_s: float = Field(
        0.08, gt=0, le=10, description="scenes are late by a random time up to this"
    )

    def late_ns(self, elapsed_ns: int, rng: np.random.Generator) -> int:
        """Return a random time."""
        return int(rng.uniform(0.0, self.max_s) * 1e9)


class Duplicate(FaultSettings):
    """Every scene arrives twice."""


class Reorder(FaultSettings):
    """Every other scene arrives after its successor."""


class Way(Generic[T]):
    """One direction of a wire, with units that are held back or delayed.

    Args:
        rng: generator of the random choices.

    Attributes:
        late: arrival time and unit, in the order of arrival.
        held: the unit that waits for its successor.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.late: deque[tuple[int, T]] = deque()
        self.held: T | None = None

    def altered(self, fault: FaultSettings, unit: T) -> list[T]:
        """Return the resulting units if a unit is lost, doubled or swapped, otherwise the unit."""
        if isinstance(fault, Drop):
            return [] if self.rng.random() < fault.probability else [unit]
        if isinstance(fault, Duplicate):
            return [unit, unit]
        if isinstance(fault, Reorder):
            held, self.held = self.held, unit if self.held is None else None
            return [] if held is None else [unit, held]
        return [unit]

    def let_go(self, active: Sequence[FaultSettings]) -> list[T]:
        """Return the unit that was held back, if the fault that held it has ended."""
        if self.held is None or any(isinstance(fault, Reorder) for fault in active):
            return []
        held, self.held = self.held, None
        return [held]

    def due(self, now_ns: int) -> list[T]:
        """Remove and return the units that have arrived by now."""
        units = []
        while self.late and self.late[0][0] <= now_ns:
            units.append(self.late.popleft()[1])
        return units
