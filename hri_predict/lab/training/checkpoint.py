"""A training run's state on disk: written whole or not at all, read without unpickling code.

The file is one line with the SHA-256 of the rest, and what ``torch.save`` wrote. Torch reads a file
with flipped bits without complaint, and the run would continue with wrong weights.
"""

import contextlib
import errno
import hashlib
import io
import os
import tempfile
from pathlib import Path
from typing import Any

import torch

from hri_predict.base.errors import ConfigError

_MARK = b"hri-predict checkpoint 2 "
_REMEDY = "remove it and start the run again"
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
        payload = io.BytesIO()
        torch.save(state, payload)
        with part.open("wb") as file:
            file.write(sealed(payload.getbuffer()))
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except (OSError, RuntimeError) as error:  # torch's writer turns a full disk into RuntimeError
        with contextlib.suppress(OSError):
            part.unlink()
        raise _unwritable(path, error) from error


def check_folder(folder: Path, resume: bool) -> None:
    """Fail before the data are read, which takes minutes, if the folder does not suit the run.

    Raises:
        ConfigError: it cannot be written, it holds a run that is not resumed, or none to resume.
    """
    path = folder / "last.pt"
    has_run = os.path.exists(path)  # takes names that are too long
    if has_run and not resume:
        raise ConfigError(
            f"{folder}: holds a run; --resume continues it; to start a new one, give another "
            f"--out, or delete the folder"
        )
    if resume and not has_run:
        raise _missing(path)
    check_writable(folder)


def check_writable(folder: Path) -> None:
    """Create a folder and check that files can be written into it.

    Raises:
        ConfigError: they cannot.
    """
    path = folder / "last.pt"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise _unwritable(path, error) from error


def _unwritable(path: Path, error: OSError | RuntimeError) -> ConfigError:
    reason, remedy = "it was cut short", "free some room, or choose another 'out'"
    if isinstance(error, OSError):
        reason = error.strerror or reason
        if error.errno not in _NO_ROOM:
            remedy = "choose another 'out'"
        if isinstance(error, FileExistsError):  # from mkdir
            reason = f"{path.parent} is not a folder"
    return ConfigError(f"checkpoint {path}: cannot be written: {reason}; {remedy}")


def _missing(path: Path) -> ConfigError:
    return ConfigError(f"checkpoint {path}: no such file; start the run without --resume")


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint that ``save_checkpoint`` wrote.

    Raises:
        ConfigError: the file is missing, damaged (the checksum does not agree), or holds anything
            but plain data.
    """
    try:
        payload = _unsealed(path, path.read_bytes())
        state = torch.load(io.BytesIO(payload), map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise _missing(path) from error
    except ConfigError:
        raise
    except Exception as error:  # torch.load's failures have no common base
        raise ConfigError(f"checkpoint {path}: cannot be read; {_REMEDY}") from error
    if not isinstance(state, dict):
        raise ConfigError(f"checkpoint {path}: not from a training run; start the run again")
    return state


def sealed(payload: bytes | memoryview) -> bytes:
    """Return a checkpoint's bytes: the checksum, and then the payload."""
    return b"".join((_MARK, hashlib.sha256(payload).hexdigest().encode(), b"\n", payload))


def _unsealed(path: Path, data: bytes) -> bytes:
    """Return the payload of a checkpoint.

    Raises:
        ConfigError: it is not what was written.
    """
    head, _, payload = data.partition(b"\n")
    if not head.startswith(_MARK):
        raise ConfigError(
            f"checkpoint {path}: has no checksum, so it is damaged or of an older version; "
            f"{_REMEDY}"
        )
    if head.removeprefix(_MARK) != hashlib.sha256(payload).hexdigest().encode():
        raise ConfigError(
            f"checkpoint {path}: is damaged (its checksum does not agree); restore it from a "
            f"backup, or {_REMEDY}"
        )
    return payload
