"""``commission --repeat``: the recorded walk, through the present version and configuration."""

import json
import shlex
from dataclasses import asdict
from pathlib import Path

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.commissioning.compare import Comparison, compare
from hri_predict.commissioning.identity import Difference, differences, identity_of
from hri_predict.commissioning.playback import grid_of, play, read_rows
from hri_predict.commissioning.report import Report, find_report, read_report
from hri_predict.operation.evidence.chain import file_hash
from hri_predict.run import config as configuration
from hri_predict.run.config import Config

OF_THE_RECORDING = ("source.kind", "source.room_from_source", "source.joint_map", "source.rate_hz")
"""Keys that were in force when the walk was recorded; a replay cannot show what they change."""


def repeat(path: Path, config: Path | None, as_json: bool) -> int:
    """Play the walk of a report again and print what changed; 1 if it is less safe or not walked.

    Raises:
        HriPredictError: the report, its recording or the configuration cannot be used.
    """
    where = find_report(path)
    report, _ = read_report(where)
    walk = report.steps.walk.result if report.steps.walk is not None else None
    if walk is None:
        raise ConfigError(f"report {where}: has no walk test; do it first (--step walk)")
    loaded = configuration.load(config or _own(where, report))
    recording = _whole(where.parent, walk.recording, walk.recording_sha256)
    old = read_rows(_whole(where.parent, walk.advices, walk.advices_sha256))
    changed = differences(report.identity, identity_of(loaded))
    played = play(loaded, recording, grid_of(loaded, walk.grid.cell_m, walk.exclude))
    found = compare(walk, old, played)
    found.worse += [_stale(each) for each in changed if _is_of_recording(each.key)]
    _show(loaded, changed, found, as_json)
    return 1 if found.worse or found.unwalked else 0


def _own(where: Path, report: Report) -> Path:
    """The configuration that the report was made of, beside it."""
    path = where.parent / report.config_path
    if not path.is_file():
        raise ConfigError(
            f"report {where}: its configuration {report.config_path} is not there; name it: "
            f"hri-predict commission CONFIG --repeat {shlex.quote(str(where))}"
        )
    return path


def _whole(folder: Path, name: str, digest: str) -> Path:
    """A file of the report, if it is as it was.

    Raises:
        RecordingError: it is missing or was changed.
    """
    path = folder / name
    try:
        found = file_hash(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}; restore it") from error
    if found != digest:
        raise RecordingError(
            f"{path}: was changed after the report was written; restore it, or walk again"
        )
    return path


_CANNOT_TELL = "the recording cannot show this"


def _is_of_recording(key: str) -> bool:
    plain = key.removeprefix("file of ").partition(" ")[0]
    return any(plain == own or plain.startswith(f"{own}.") for own in OF_THE_RECORDING)


def _stale(change: Difference) -> str:
    return f"{change}: {_CANNOT_TELL}, it was made with the old value; walk again"


def _show(config: Config, changed: list[Difference], found: Comparison, as_json: bool) -> None:
    if as_json:
        data = {"config": str(config.path), "changed": [asdict(each) for each in changed]}
        lines = {"less_safe": found.worse, "not_walked": found.unwalked, "other": found.other}
        print(json.dumps({**data, **lines}))
        return
    for each in changed:
        print(f"changed: {each}")
    for line in found.other:
        print(f"differs: {line}")
    for line in found.worse:
        print(f"{'NOT KNOWN' if _CANNOT_TELL in line else 'LESS SAFE'}: {line}")
    for line in found.unwalked:
        print(f"NOT WALKED: {line}")
    if not (found.worse or found.unwalked or found.other):
        print("the recorded walk gives the same advice, tick by tick")
    elif not found.worse:
        print("nothing got less safe")
