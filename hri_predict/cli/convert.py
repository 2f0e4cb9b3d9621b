"""``convert``: convert a recording from one format to another."""

import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from hri_predict.base.errors import ConfigError, LostRecordingError, RecordingError
from hri_predict.base.settings import MAX_RATE_HZ, MIN_RATE_HZ
from hri_predict.cli.common import (
    JointMapOption,
    JsonOption,
    TopicOption,
    one_of,
    own_map,
    progress,
    without_effect,
)
from hri_predict.contracts.joint_map import METRES_PER_UNIT
from hri_predict.recording.bounded import watching
from hri_predict.recording.converting import write_recording
from hri_predict.recording.cutting import between, decimated, of_person
from hri_predict.recording.format_table import ANY_ENDING, BY_NAME, FORMATS, of_ending
from hri_predict.recording.frames import Written
from hri_predict.recording.opening import open_recording
from hri_predict.recording.plausibility import check_possible
from hri_predict.recording.recording import SELF_EXPLAINED, Recording, from_left_handed
from hri_predict.recording.unused import unused

_MAX_START_S = 1e9
_UNTIMED = ", ".join(each.ending for each in FORMATS if each.may_lack_times)


def convert(
    *,
    source: Annotated[Path, typer.Argument(metavar="INPUT", help=ANY_ENDING)],
    output: Annotated[Path, typer.Argument(help="The file to write; its ending gives the format.")],
    to: Annotated[
        str | None,
        typer.Option(help=f"Output format: {', '.join(BY_NAME)} (amass and pack are .npz)."),
    ] = None,
    person: Annotated[
        int | None,
        typer.Option(
            help="Only this person; where INPUT has no ids, the id to give.", min=0, max=65535
        ),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(help="Drop frames to this rate, per second.")
    ] = None,
    start: Annotated[
        float, typer.Option(help="Skip everything before this time, seconds.", min=0)
    ] = 0.0,
    end: Annotated[
        float | None, typer.Option(help="Skip everything after this time, seconds.")
    ] = None,
    units: Annotated[
        str | None, typer.Option(help="Unit of INPUT: m, cm, mm, inch, ft, or metres per unit.")
    ] = None,
    axes: Annotated[
        str | None,
        typer.Option(help="Axes of INPUT that are forward, left and up, such as z,x,y for y up."),
    ] = None,
    left_handed: Annotated[
        bool,
        typer.Option("--left-handed", help="INPUT's axes are left-handed; requires --axes."),
    ] = False,
    fps: Annotated[
        float | None,
        typer.Option(help=f"Frames per second of an INPUT without times ({_UNTIMED})."),
    ] = None,
    joint_map: JointMapOption = None,
    topic: TopicOption = None,
    force: Annotated[bool, typer.Option("--force", help="Replace OUTPUT.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Convert a recording to another format, and report data that the format cannot hold.

    OUTPUT is in metres, z up, except for c3d (millimetres), trc (millimetres, y up) and bvh
    (centimetres, y up). mcap is for replay.

    Example: hri-predict convert walk.c3d walk.csv --rate 30 --person 1
    """
    kind = _format(output, to)
    if left_handed and axes is None:
        raise ConfigError(
            "--left-handed: needs --axes, INPUT's axes that are forward, left and up: Unity's are "
            "z,-x,y, Unreal's x,-y,z"
        )
    with _watched(source):
        recording = open_recording(
            source,
            person=1 if person is None else person,
            unit_m=None if units is None else _unit(units),
            axes=None if axes is None or left_handed else axes.split(","),
            rate_hz=fps,
            any_joints=True,
            joint_map=own_map(joint_map),
            topic=topic,
        )
        if recording.kind in SELF_EXPLAINED:
            without_effect({"--units": units, "--axes": axes}, f"on {source}, which states its own")
        elif left_handed and axes is not None:
            recording = from_left_handed(recording, axes.split(","))
        doubt = _doubt(
            recording,
            lambda unit_m: open_recording(
                source,
                unit_m=unit_m,
                rate_hz=fps,
                any_joints=True,
                joint_map=own_map(joint_map),
                topic=topic,
            ),
        )
        recording, others = _chosen(
            recording=recording, person=person, rate=rate, start=start, end=end
        )
        written = write_recording(recording, output, kind, force=force)
        written.dropped["other people"] += others
        written.notes.extend([doubt] if doubt else [])
    _tell(_summary(recording, output, kind, written), as_json)


@contextmanager
def _watched(source: Path) -> Iterator[None]:
    """Show the progress of reading and writing a long file, on a terminal."""
    with progress() as bar:
        task = bar.add_task(f"reading {source.name}", total=None)
        with watching(
            lambda what, done, total: bar.update(
                task, description=f"{what} {source.name}", completed=done, total=total
            )
        ):
            yield


def _doubt(recording: Recording, reopened: Callable[[float], Recording]) -> str:
    """Return why the file's people are implausible, with the remedy; "" if they are plausible.

    Raises:
        LostRecordingError: the output would lack most joints, and no unit could bring them back.
    """
    try:
        check_possible(recording, reopened)
    except LostRecordingError:
        raise
    except RecordingError as error:
        return str(error).removeprefix(f"recording {recording.path}: ")
    return ""


def _format(output: Path, to: str | None) -> str:
    same = of_ending(output.suffix.lower())
    possible = [each for each in same if each.write is not None]
    if to is not None:
        chosen = BY_NAME[str(one_of("--to", to, list(BY_NAME)))]
        if chosen not in same:  # no reader would take it for what it is
            raise ConfigError(
                f"{output}: --to {to} writes '{chosen.ending}' files, and '{output.suffix}' means"
                f" {'another' if same else 'no'} format; name it {output.stem}{chosen.ending}"
                + (f", or use --to {possible[0].name}" if possible else "")
            )
        return chosen.name
    if not possible:
        endings = dict.fromkeys(each.ending for each in BY_NAME.values())
        why = "can be read but not written: ending" if same else "unknown ending"
        raise ConfigError(f"{output}: {why} '{output.suffix}'; use {', '.join(endings)}")
    return possible[0].name


def _unit(text: str) -> float:
    try:
        unit_m = METRES_PER_UNIT[text] if text in METRES_PER_UNIT else float(text)
    except ValueError:
        unit_m = math.nan
    if not 0 < unit_m <= 1000:
        raise ConfigError(
            f"--units {text}: use one of {', '.join(METRES_PER_UNIT)}, or metres per unit"
        )
    return unit_m


def _chosen(
    *, recording: Recording, person: int | None, rate: float | None, start: float, end: float | None
) -> tuple[Recording, int]:
    """Return the requested part, and the number of people left out."""
    if not 0 <= start <= _MAX_START_S:
        raise ConfigError(f"--start {start:g}: must be 0 to {_MAX_START_S:g} s")
    if end is not None and not end > start:
        raise ConfigError(f"--end {end:g}: must be after --start {start:g}")
    if rate is not None and not MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
        raise ConfigError(f"--rate {rate:g}: must be {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}")
    recording = between(recording, start, end)
    others = 0
    if person is not None:
        recording, others = of_person(recording, person)
    return recording if rate is None else decimated(recording, rate), others


def _summary(recording: Recording, output: Path, kind: str, written: Written) -> dict[str, Any]:
    notes = [recording.note] if recording.note else []
    if recording.floor_m:
        way = "lowered" if recording.floor_m > 0 else "raised"
        by_cm = abs(recording.floor_m) * 100
        notes.append(f"heights are {way} by {by_cm:.1f} cm, so that the floor is at 0")
    joints = len(recording.joint_map.source_joints) if written.joints is None else written.joints
    notes += written.notes
    if line := unused(recording.joint_map):
        notes.append(line)
    if not recording.joint_map.mapped.any():
        notes.append(
            "no canonical joint can be found from the joints' names, so it cannot be replayed"
        )
    return {
        "input": str(recording.path),
        "from": recording.kind,
        "output": str(output),
        "to": kind,
        "frames": written.frames,
        "rate_hz": recording.rate_hz,
        "seconds": recording.duration_s,
        "people": written.people,
        "joints": joints,
        "dropped": {what: count for what, count in written.dropped.items() if count},
        "notes": notes,
    }


def _tell(summary: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print(json.dumps(summary))
        return
    print(
        "{output}: {frames} frames, {seconds:.2f} s at {rate_hz:g} per second, people "
        "{people}, {joints} joints".format(**summary | {"people": summary["people"] or "none"})
    )
    for what, count in summary["dropped"].items():
        print(f"dropped: {count} {what}", file=sys.stderr)
    for note in summary["notes"]:
        print(f"note: {note}", file=sys.stderr)
