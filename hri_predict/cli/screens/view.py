"""``view``: show a recording in the 3D view."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from hri_predict.base.errors import RecordingError
from hri_predict.viewing.feed import VIEWER, check_viser
from hri_predict.viewing.recorded import RecordedPictures
from hri_predict.viewing.screen import LOOPBACK, ScreenSettings, check_port

LARGE_BYTES = 50_000_000
"""Above this size reading takes seconds, so a message is printed."""


def view(
    *,
    recording: Annotated[Path, typer.Argument(help="A recording of the node: .mcap.")],
    port: Annotated[int, typer.Option(help="0: any free port.")] = 0,
    host: Annotated[
        str,
        typer.Option(
            "--viewer-host",
            help="Address to listen on. Everyone who can reach it can see where people were.",
        ),
    ] = LOOPBACK,
) -> None:
    """Show a recording in 3D in a browser, with a timeline of levels; Ctrl-C ends it.

    Example: hri-predict view monday.mcap
    """
    check_viser()
    check_port(ScreenSettings("port", VIEWER, port, host))
    try:
        if (size := recording.stat().st_size) > LARGE_BYTES:
            print(f"view: reading the levels of {size / 1e6:.0f} MB", file=sys.stderr, flush=True)
        recorded = RecordedPictures(recording)
    except OSError as error:
        raise RecordingError(
            f"recording {recording}: cannot be read ({error.strerror}); name another file"
        ) from error
    from hri_predict.viewing.scene3d.playback import play

    play(recorded, host, port, lambda url: print(f"view: {url}", file=sys.stderr, flush=True))
