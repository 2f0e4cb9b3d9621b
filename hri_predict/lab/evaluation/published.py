"""Numbers published in papers, as data: method, paper, table, protocol (``published.yaml``)."""

from functools import cache
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator
from yaml import YAMLError

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import load_yaml, read_text
from hri_predict.base.settings import Settings, validated

ErrorKind = Literal["mpjpe", "euler"]


class Published(Settings):
    """A method's published errors under one protocol of a benchmark.

    Attributes:
        columns: future frames of the errors, from 0.
        errors: by action, the error at each column; ``None`` where it is not published.
    """

    method: str
    paper: str
    table: str
    windows: str
    n_in: int = 10
    n_out: Literal[10, 25]
    error: ErrorKind
    columns: list[int] = Field(min_length=1)
    errors: dict[str, list[float | None]]
    note: str = ""

    @model_validator(mode="after")
    def _complete(self) -> "Published":
        for action, errors in self.errors.items():
            if len(errors) != len(self.columns):
                raise ValueError(f"{action}: must have as many errors as columns")
        return self

    def at(self, action: str, frame: int) -> float | None:
        """The published error at a future frame, or ``None``."""
        if action not in self.errors or frame not in self.columns:
            return None
        return self.errors[action][self.columns.index(frame)]


class _File(Settings):
    published: list[Published]


@cache
def published(file: Path) -> tuple[Published, ...]:
    """All published numbers of a file.

    Raises:
        ConfigError: the file cannot be read, is not a YAML list, or an entry is wrong.
    """
    try:
        entries = load_yaml(read_text(file, "printed numbers"))
    except (YAMLError, RecursionError) as error:
        raise ConfigError(f"printed numbers {file}: not valid YAML; correct it") from error
    return tuple(validated(_File, {"published": entries}, str(file)).published)


def comparable(file: Path, windows: str, *, n_in: int, n_out: int, error: str) -> list[Published]:
    """The published numbers of one protocol alone.

    Seeded windows are the same for 10 and 25 frames, so their length does not matter. The set of
    all windows of a recording differs between 10 and 25 frames.
    """
    return [
        entry
        for entry in published(file)
        if entry.windows == windows
        and entry.n_in == n_in
        and entry.error == error
        and (entry.n_out == n_out or windows != "all")
    ]
