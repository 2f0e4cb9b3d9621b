"""All mistakes of a configuration, each with its line in the file."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from hri_predict.base.errors import ConfigError, ConfigMistakes
from hri_predict.base.files import line_of
from hri_predict.base.settings import Mistake, Settings, mistakes
from hri_predict.contracts import registry

Keys = tuple[str | int, ...]
MAX_SHOWN = 50

S = TypeVar("S", bound=Settings)


def place(path: Path, text: str, keys: Keys) -> str:
    """Return the location of ``keys`` in the file's text: ``cell.yaml:17: robots.0.name``."""
    at = f"{path}:{line_of(text, keys)}"
    return f"{at}: {'.'.join(map(str, keys))}" if keys else at


def scalars(data: Any, keys: Keys = ()) -> Iterator[tuple[Keys, str]]:
    """Yield each text in the data of a YAML file, with its keys."""
    if isinstance(data, str):
        yield keys, data
    elif isinstance(data, dict | list):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from scalars(value, (*keys, key))


class Mistakes:
    """Collects the mistakes in one file, so that a user sees all of them together."""

    def __init__(self, path: Path, text: str) -> None:
        self._path, self._text = path, text
        self._found: list[Mistake] = []

    def __bool__(self) -> bool:
        return bool(self._found)

    def add(self, keys: Keys, text: str) -> None:
        """Record a mistake at ``keys``, with its remedy."""
        self._found.append(Mistake(keys, text))

    def settings(self, model: type[S], data: Any, keys: Keys = ()) -> S | None:
        """Validate the block at ``keys``; ``None`` if it is wrong."""
        try:
            return model.model_validate(data)
        except ValidationError as error:
            for each in mistakes(error, model, data):
                self.add((*keys, *each.keys), each.text)
            return None

    def part(self, kind: registry.PartKind, name_key: str, data: Any, keys: Keys) -> Any:
        """Validate a block with the settings model of the named part; ``None`` if it is wrong."""
        if not isinstance(data, dict):
            return None  # the model of the whole file has said so
        name = data.get(name_key)
        if not isinstance(name, str):
            there = ", ".join(registry.names(kind))
            self.add((*keys, name_key), f"missing; use one of: {there}")
            return None
        try:
            if kind == "predictors":  # its settings alone: a network's module imports torch
                model: Any = registry.predictor_settings(name)
            else:
                model = registry.load(kind, name).settings_model
        except ConfigError as error:
            self.add((*keys, name_key), str(error))
            return None
        return self.settings(model, data, keys)

    def tell(self) -> None:
        """Raise the recorded mistakes, if any.

        Raises:
            ConfigMistakes: one line for each mistake, in the order of the file.
        """
        if not self._found:
            return
        shown = [(line_of(self._text, m.keys), m) for m in self._found[:MAX_SHOWN]]
        shown.sort(key=lambda pair: pair[0])
        lines = [
            f"{self._path}:{line}: {each.path}: {each.text}"
            if each.keys
            else f"{self._path}:{line}: {each.text}"
            for line, each in shown
        ]
        more = len(self._found) - len(lines)
        if more > 0:
            lines.append(f"{self._path}: {more} more mistakes; correct these first")
        raise ConfigMistakes(lines)
