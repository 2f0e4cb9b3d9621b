"""``report``: what a shift was like, as one page of HTML."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.files import atomic_write
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.shift.page import page
from hri_predict.explaining.shift.tally import tally
from hri_predict.explaining.times import asked


def report(
    *,
    recording: Annotated[
        list[Path], typer.Argument(help="Recordings of one cell (.mcap), or folders of them.")
    ],
    begin: Annotated[
        str | None, typer.Option("--from", help="From this time on; as explain's --at.")
    ] = None,
    end: Annotated[str | None, typer.Option("--to", help="Until before this time.")] = None,
    out: Annotated[Path, typer.Option(help="The page to write.")] = Path("shift.html"),
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the figures as JSON, and write no page.")
    ] = False,
) -> None:
    """Report a shift: time per level, stops and their causes, near misses, forecasts, losses.

    Example: hri-predict report recordings/ --from 06:00 --to 14:00 --out shift.html
    """
    if out.suffix.lower() not in (".html", ".htm"):
        raise ConfigError(f"--out {out}: the page is HTML; write a name that ends in .html")
    try:
        recordings = Recordings(recording)
        start_ns = None if begin is None else asked(begin, recordings, "--from").start_ns
        end_ns = None if end is None else asked(end, recordings, "--to").start_ns
        if start_ns is not None and end_ns is not None and end_ns <= start_ns:
            raise ConfigError(f"--to {end}: is not after --from {begin}; swap them")
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
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(out, page(shift, [str(path) for path in recording]).encode())
    except OSError as error:
        raise ConfigError(
            f"--out {out}: cannot be written: {error.strerror}; name another file"
        ) from error
    for note in recordings.notes:
        print(f"note: {note}", file=sys.stderr)
    print(f"written: {out}", file=sys.stderr)
