"""``explain``: explain why a robot slowed or stopped at a given time."""

import json
import shlex
import shutil
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from hri_predict.base.errors import ConfigError, RecordingError, nearest
from hri_predict.base.files import atomic_write
from hri_predict.cli.common import JsonOption, without_effect, writing
from hri_predict.explaining.episodes import episodes
from hri_predict.explaining.explanation import explain as explained
from hri_predict.explaining.explanation import is_slowed, listing, neighbours
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.shift.page import page
from hri_predict.explaining.shift.tally import tally
from hri_predict.explaining.situation import Situation, nearest_episodes, situation
from hri_predict.explaining.times import AskedTime, asked
from hri_predict.explaining.words import HEAD, line_of, told

PICTURES = (".png", ".svg")


def explain(
    *,
    recording: Annotated[
        Path, typer.Argument(help="A recording of the node (.mcap), or a folder of one cell's.")
    ],
    at: Annotated[
        str | None,
        typer.Option(
            help="Time to explain: 14:03:07 (UTC), 2026-03-09T14:03:07, or seconds since the "
            "start. Without it, all slowdowns and stops are listed."
        ),
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="Only this robot; default: the one slowed most at that time.")
    ] = None,
    following: Annotated[
        bool,
        typer.Option(
            "--next", help="If no robot was slowed at that time, explain the next slowdown."
        ),
    ] = False,
    picture: Annotated[
        Path | None, typer.Option(help="Draw plan and timeline into this .png or .svg file.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Explain why a robot slowed or stopped, from a recording alone.

    Example: hri-predict explain recordings/ --at 14:03:07 --picture why.png
    """
    if picture is not None and picture.suffix.lower() not in PICTURES:
        raise ConfigError(f"--picture {picture}: use a name that ends in .png or .svg")
    if at is None:
        without_effect({"--picture": picture, "--next": following or None}, "without --at")
    draw = _drawer() if picture is not None else None
    try:
        recordings = Recordings([recording])
        if at is None:
            rows = _slowdowns(recordings, robot)
        else:
            about = _about(recordings, asked(at, recordings), robot, following)
            found = explained(about)
            if not is_slowed(found):
                found["nearest"] = neighbours(about)
    except OSError as error:
        raise RecordingError(f"recording {recording}: cannot be read: {error.strerror}") from error
    if at is None:
        _list(rows, recordings, robot, as_json)
        return
    if as_json:
        print(json.dumps(found))
    else:
        _print(found, recording)
    if draw is not None and picture is not None:
        draw(about, found, picture)
        print(f"written: {picture}", file=sys.stderr)


def _drawer() -> Any:
    """Fail now if pictures cannot be drawn."""
    from hri_predict.explaining.drawing.picture import draw

    return draw


def _about(recordings: Recordings, at: AskedTime, robot: str | None, following: bool) -> Situation:
    about = situation(recordings, at, robot)
    if not following or about.episode is not None:
        return about
    _, after = nearest_episodes(recordings, about.robot, about.advice.utc_ns)
    if after is None:
        raise ConfigError(f"--next: {about.robot} was not slowed or stopped after that time")
    return situation(recordings, AskedTime(after.worst.first.utc_ns, 1), about.robot)


def _width() -> int:
    """Return the width for prose; more than 100 characters are hard to read."""
    return max(40, min(100, shutil.get_terminal_size((80, 24)).columns))


def _list_width() -> int | None:
    """Return the terminal's width; ``None``: a pipe or file has none, and gets whole lines."""
    return max(40, shutil.get_terminal_size((80, 24)).columns) if sys.stdout.isatty() else None


def _print(found: dict[str, Any], recording: Path) -> None:
    for line in told(found, _width()):
        print(line)
    around = found.get("nearest")
    if around is None:
        return
    for when, words in (("before", "the last slowdown before"), ("after", "the next one after")):
        episode = around[when]
        print()
        if episode is None:
            print(f"{words}: none")
        else:
            print(f"{words}:")
            print(line_of(episode, _list_width()))
            print(f"  hri-predict explain {shlex.quote(str(recording))} --at {episode['at']}")


def _slowdowns(recordings: Recordings, robot: str | None) -> list[dict[str, Any]]:
    there = {name for file in recordings.files for name, _ in file.info.robots}
    if robot is not None and there and robot not in there:
        raise ConfigError(
            f"--robot {robot}: no such robot{nearest(robot, there)}; available: "
            f"{', '.join(sorted(there))}"
        )
    found = [e for e in episodes(recordings.read(["/advice"])) if robot in (None, e.robot)]
    found.sort(key=lambda episode: episode.start_ns)
    return [listing(episode, recordings) for episode in found]


def _list(
    rows: list[dict[str, Any]], recordings: Recordings, robot: str | None, as_json: bool
) -> None:
    if as_json:
        print(json.dumps({"slowdowns": rows, "notes": recordings.notes}))
        return
    if rows:
        print(HEAD)
    day = ""
    for row in rows:
        if recordings.info.has_utc and row["at"][:10] != day:
            day = row["at"][:10]
            print(f"{day}, UTC")
        print(line_of(row, _list_width()))
    if not rows:
        print("no slowdown and no stop was recorded" + (f" for {robot}" if robot else ""))
    for note in recordings.notes:
        print(f"note: {note}")


# -- report: what a shift was like, as one page of HTML --------------------------------------------


def report(
    *,
    recording: Annotated[
        list[Path], typer.Argument(help="Recordings of one cell (.mcap), or folders of them.")
    ],
    begin: Annotated[
        str | None, typer.Option("--from", help="Start time, in the format of explain's --at.")
    ] = None,
    end: Annotated[str | None, typer.Option("--to", help="End time (exclusive).")] = None,
    out: Annotated[Path, typer.Option(help="The page to write.")] = Path("shift.html"),
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the figures as JSON, and write no page.")
    ] = False,
) -> None:
    """Report on a shift: time per level, stops and causes, near misses, forecasts, losses.

    Example: hri-predict report recordings/ --from 06:00 --to 14:00 --out shift.html
    """
    if out.suffix.lower() not in (".html", ".htm"):
        raise ConfigError(f"--out {out}: the page is HTML; use a name that ends in .html")
    try:
        recordings = Recordings(recording)
        start_ns = None if begin is None else asked(begin, recordings, "--from").start_ns
        end_ns = None if end is None else asked(end, recordings, "--to").start_ns
        if start_ns is not None and end_ns is not None and end_ns <= start_ns:
            raise ConfigError(f"--to {end}: not after --from {begin}; swap them")
        shift = tally(recordings, start_ns, end_ns)
    except OSError as error:
        raise RecordingError(
            f"recording {recording[0]}: cannot be read: {error.strerror}"
        ) from error
    if not shift["robots"]:
        raise ConfigError("--from, --to: no advice was recorded in that time; ask for another")
    if as_json:
        print(json.dumps(shift))
        return
    with writing(f"--out {out}", "name another file"):
        out.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(out, page(shift, [str(path) for path in recording]).encode())
    for note in recordings.notes:
        print(f"note: {note}", file=sys.stderr)
    print(f"written: {out}", file=sys.stderr)
