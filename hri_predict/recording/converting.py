"""Writes a recording in any format."""

from pathlib import Path

from hri_predict.base.errors import ConfigError, OsErrorAs, RecordingError
from hri_predict.base.files import atomic_file
from hri_predict.recording.format_table import BY_NAME
from hri_predict.recording.frames import Written
from hri_predict.recording.recording import Recording

ERRORS = "position errors stated by the source: zones in a replay are smaller"
"""Data that only the node's own format holds."""


def write_recording(recording: Recording, output: Path, to: str, *, force: bool = False) -> Written:
    """Write ``output`` completely or not at all.

    Args:
        recording: the recording to write.
        output: the file.
        to: name of its format, one of ``BY_NAME``.
        force: replace an existing file, but never the input.

    Raises:
        RecordingError: it cannot be written, or this format cannot hold the recording.
        ConfigError: the file exists, or the format cannot hold the joints' names.
    """
    with OsErrorAs(RecordingError, f"{output}: cannot be written", "name another file"):
        if output.exists():
            _check_replaceable(recording, output, force)
        write = BY_NAME[to].write
        assert write is not None
        with atomic_file(output) as partial:
            written = write(partial, recording)
    if to != "mcap":
        people = [person for scene in recording.scenes for person in scene.people]
        if stated := sum(person.error_m != 0 for person in people):
            written.dropped[ERRORS] += stated
    return written


def _check_replaceable(recording: Recording, output: Path, force: bool) -> None:
    if output.is_dir():
        raise ConfigError(f"{output}: is a folder; name a file in it")
    if recording.path.exists() and output.samefile(recording.path):
        raise ConfigError(f"{output}: is the input recording; name another file")
    if not force:
        raise ConfigError(f"{output}: already exists; --force replaces it")
