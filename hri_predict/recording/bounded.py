"""Reads files of unknown origin into memory, up to a limit."""

from pathlib import Path

from hri_predict.errors import RecordingError

MAX_BYTES = 2**30  # of a file, and of the joint positions read from it


def read_bounded(path: Path) -> bytes:
    """The whole file.

    Raises:
        RecordingError: it is larger than ``MAX_BYTES``.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise RecordingError(
            f"recording {path}: larger than {MAX_BYTES / 2**30:g} GiB; cut it into parts"
        )
    return data


def read_text(path: Path, what: str) -> str:
    """The whole file as text: UTF-8, or else one byte per character, as old programs write.

    Raises:
        RecordingError: too large, or not text.
        OSError: it cannot be read.
    """
    data = read_bounded(path)
    if b"\0" in data[:4096]:
        raise RecordingError(f"recording {path}: not {what} (not text)")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def check_joints(path: Path, frames: int, people: int, joints: int) -> None:
    """Refuse recordings that would fill the memory.

    Raises:
        RecordingError: more than ``MAX_BYTES`` of joint positions.
    """
    if frames * people * joints * 24 > MAX_BYTES:
        raise RecordingError(
            f"recording {path}: {frames} frames of {people} people with {joints} joints are too "
            f"many to hold; cut it into parts"
        )
