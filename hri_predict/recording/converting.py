"""Writes a recording in any format."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

from hri_predict.base.errors import ConfigError, OsErrorAs, RecordingError
from hri_predict.base.files import atomic_file
from hri_predict.contracts.scene import Person, Scene
from hri_predict.recording.format_table import BY_NAME
from hri_predict.recording.frames import Written
from hri_predict.recording.recording import Recording

ERRORS = "position errors stated by the source: zones in a replay are smaller"
DOUBTED = "scenes that their source doubted: written as not seen"
TWICE = "scenes with two bodies of one id: written as not seen, without these bodies"
JOINED = "ids that the source corrected, because two were one person"
"""Data that only the node's own format holds."""


NODES_OWN = "mcap"


def write_recording(recording: Recording, output: Path, to: str, *, force: bool = False) -> Written:
    """Write ``output`` completely or not at all.

    Only the node's own format holds doubts of a source and two bodies with one id. Other formats
    get such scenes as not seen, so that a replay is never milder than the original, and
    ``Written.dropped`` counts them.

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
        lost = Counter[str]()
        if to != NODES_OWN:
            recording, lost = _for_others(recording)
        with atomic_file(output) as partial:
            written = write(partial, recording)
    written.dropped.update(lost)
    return written


def _for_others(recording: Recording) -> tuple[Recording, Counter[str]]:
    """Return the recording as formats of others can hold it, and what it then lacks."""
    lost = Counter[str]()
    scenes = []
    for scene in recording.scenes:
        lost[ERRORS] += sum(person.error_m != 0 for person in scene.people)
        lost[DOUBTED] += bool(scene.doubts)
        lost[JOINED] += len(scene.joined)
        people = _unambiguous(scene)
        twice = len(people) < len(scene.people)
        lost[TWICE] += twice
        sees_room = scene.sees_room and not scene.doubts and not twice
        scenes.append(replace(scene, sees_room=sees_room, people=people))
    return replace(recording, scenes=scenes), +lost  # counts above 0


def _unambiguous(scene: Scene) -> tuple[Person, ...]:
    """The people whose id only one body of the scene has."""
    bodies = Counter(person.id for person in scene.people)
    return tuple(person for person in scene.people if bodies[person.id] == 1)


def _check_replaceable(recording: Recording, output: Path, force: bool) -> None:
    if output.is_dir():
        raise ConfigError(f"{output}: is a folder; name a file in it")
    if recording.path.exists() and output.samefile(recording.path):
        raise ConfigError(f"{output}: is the input recording; name another file")
    if not force:
        raise ConfigError(f"{output}: already exists; --force replaces it")
