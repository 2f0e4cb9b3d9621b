"""A training run's state on disk: written whole or not at all, read without unpickling code."""

import contextlib
import errno
import os
from pathlib import Path
from typing import Any

import torch

from hri_predict.base.errors import ConfigError

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def save_checkpoint(path: Path, state: dict[str, Any]) -> None:
    """Replace ``path`` with ``state`` (tensors, numbers, strings, lists and dicts of them).

    A reader finds the old file or the new one, never a part, even after a crash or power cut.

    Raises:
        ConfigError: the folder cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as file:
            torch.save(state, file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except (OSError, RuntimeError) as error:  # torch's writer turns a full disk into RuntimeError
        with contextlib.suppress(OSError):
            part.unlink()
        reason, remedy = "it was cut short", "free some room, or choose another 'out'"
        if isinstance(error, OSError):
            reason = error.strerror or reason
            if error.errno not in _NO_ROOM:
                remedy = "choose another 'out'"
            if isinstance(error, FileExistsError):  # from mkdir
                reason = f"{path.parent} is not a folder"
        raise ConfigError(f"checkpoint {path}: cannot be written: {reason}; {remedy}") from error


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint that ``save_checkpoint`` wrote.

    Raises:
        ConfigError: the file is missing, damaged, or holds anything but plain data.
    """
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise ConfigError(
            f"checkpoint {path}: no such file; start the run without --resume"
        ) from error
    except Exception as error:  # torch.load's failures have no common base
        raise ConfigError(
            f"checkpoint {path}: cannot be read; remove it and start the run again"
        ) from error
    if not isinstance(state, dict):
        raise ConfigError(f"checkpoint {path}: not from a training run; start the run again")
    return state
