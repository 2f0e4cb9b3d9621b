"""The folder of a validation: the report, and the state from which it can be resumed later."""

import json
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import atomic_write, read_text
from hri_predict.base.settings import Settings
from hri_predict.commissioning.identity import identity_of
from hri_predict.commissioning.page import page_of
from hri_predict.commissioning.report import PAGE, Lines, Report, Signature, Steps, write_report
from hri_predict.run.config import Config
from hri_predict.run.review.less_safe import less_safe_settings

STATE = "state.json"


class State(Settings):
    """Steps done so far."""

    cell: str = Field(description="name of the configuration's file")
    steps: Steps = Steps()
    notes: Lines = []
    signatures: list[Signature] = []

    def with_step(self, name: str, step: Any) -> "State":
        """Return the state after a step was done, for the first time or again."""
        return self.model_copy(update={"steps": self.steps.model_copy(update={name: step})})


def load_state(folder: Path, config: Config) -> State:
    """Return the state of a folder, or a new state if it has none.

    Raises:
        ConfigError: the state cannot be read, or belongs to another cell.
    """
    path = folder / STATE
    if not path.exists():
        return State(cell=config.path.name)
    try:
        state = State.model_validate(json.loads(read_text(path, "state")))
    except (ValidationError, ValueError, RecursionError) as error:
        raise ConfigError(
            f"state {path}: cannot be used ({type(error).__name__}); give another --out"
        ) from error
    if state.cell != config.path.name:
        raise ConfigError(
            f"--out {folder}: holds the validation of {state.cell}, not of {config.path.name}; "
            f"give another folder"
        )
    return state


def save(folder: Path, config: Config, state: State) -> tuple[Report, str]:
    """Write the state, and the report as JSON and HTML; return the report and its hash.

    Raises:
        ConfigError: the folder cannot be written.
    """
    report = Report(
        cell=config.path.name,
        config_path=os.path.relpath(config.path.absolute(), folder.absolute()),
        made=datetime.now(UTC).replace(microsecond=0),
        identity=identity_of(config),
        steps=state.steps,
        less_safe=[str(each) for each in less_safe_settings(config)],
        notes=state.notes,
        signatures=state.signatures,
    )
    with OsErrorAs(ConfigError, f"--out {folder}: cannot be written", "name another folder"):
        atomic_write(folder / STATE, (state.model_dump_json(indent=1) + "\n").encode())
        digest = write_report(report, folder)
        atomic_write(folder / PAGE, page_of(report, digest).encode("utf-8", "replace"))
    return report, digest
