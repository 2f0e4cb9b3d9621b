"""``check``: what the node would keep as evidence, and whether there is room for it."""

import os
import shutil
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import demand_kind
from hri_predict.run.config import Config


def evidence_facts(config: Config) -> dict[str, Any] | None:
    """The settings of ``evidence:``, with the folder; ``None`` without them. Opens nothing.

    Raises:
        ConfigError: the folder is something else.
    """
    settings = config.node.evidence
    if settings is None:
        return None
    folder = config.base_dir / settings.folder
    try:
        demand_kind(folder, folder=True)
    except OSError as error:
        raise ConfigError(
            f"evidence.folder {folder}: {error.strerror}; name another folder"
        ) from error
    return {
        **settings.model_dump(),
        "folder": str(folder),
        "notes": _notes(folder, settings.max_mb),
    }


def evidence_line(facts: dict[str, Any] | None) -> str:
    """The same for a person."""
    if facts is None:
        return "evidence: none is kept"
    kinds = ", ".join(kind.replace("_", " ") for kind in facts["of"])
    return (
        f"evidence: {facts['before_s']:g} s before and {facts['after_s']:g} s after each {kinds}, "
        f"in {facts['folder']}, up to {facts['max_mb']:g} MB"
    )


def evidence_notes(facts: dict[str, Any] | None) -> list[str]:
    """Return the problems that would keep the node from writing evidence."""
    return [] if facts is None else list(facts["notes"])


def _notes(folder: Path, max_mb: float) -> list[str]:
    there = next((each for each in (folder, *folder.absolute().parents) if each.is_dir()), None)
    if there is None:
        return []
    if not os.access(there, os.W_OK):
        return [f"evidence.folder {folder}: {there} cannot be written by this user"]
    free_mb = shutil.disk_usage(there).free / 1e6
    if free_mb < max_mb:
        return [
            f"evidence.max_mb {max_mb:g}: only {free_mb:.0f} MB are free there; events are lost "
            f"when the disk is full"
        ]
    return []
