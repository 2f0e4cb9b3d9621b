"""``try``: see yourself, the forecast and a moving robot in 3D."""

import contextlib
import os
import subprocess
import sys
import threading
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Annotated

import typer

from hri_predict.base.errors import ConfigError, SourceError
from hri_predict.cli.common import without_effect
from hri_predict.cli.run import go
from hri_predict.cli.screens.options import screens
from hri_predict.cli.tryout.camera import LOOPBACK, Camera
from hri_predict.cli.tryout.cell import Place, place_of, with_camera, with_person
from hri_predict.run.session import Options
from hri_predict.viewing.feed import VIEWER, Feed, check_viser
from hri_predict.viewing.screen import ScreenSettings, check_port

BESIDE_THE_VIEW = Place(3.0, -1.5)
"""Default pose of the robot; the camera is at the room's origin and looks along x."""
FIRST_CAMERA = "0"
AGAIN = "--loop"
SLOWER = ["--max-fps", "15"]
"""Rate of ``camera.yaml``, which leaves time for forecasts on two cores."""
MAX_SECONDS = 1e6


def try_it(
    more: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[-- OPTIONS]", help="Options of 'hri-predict camera', such as --height 1.8."
        ),
    ] = None,
    *,
    video: Annotated[
        Path | None, typer.Option(help="Play this video file instead of a camera.")
    ] = None,
    camera: Annotated[
        str | None, typer.Option(help="The camera, as 'hri-predict camera' names it: 0, 1, ...")
    ] = None,
    person: Annotated[
        bool, typer.Option("--person", help="Show the demo's person instead of a camera's people.")
    ] = False,
    robot: Annotated[
        str | None,
        typer.Option(metavar="X,Y[,YAW]", help="Pose of the UR5e in the room (m, m, rad)."),
    ] = None,
    viewer: Annotated[
        int, typer.Option(metavar="PORT", help="Port of the 3D view; 0: any free port.")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Only print the address; open no browser.")
    ] = False,
    seconds: Annotated[float | None, typer.Option(help="Stop after this many seconds.")] = None,
) -> None:
    """See yourself in 3D: a camera, the node, the forecast and a moving robot; Ctrl-C ends it.

    Without a camera, the demo's person approaches the robot.

    Example: hri-predict try
    """
    given = {"--video": video, "--camera": camera, "--person": person or None}
    names = [name for name, value in given.items() if value is not None]
    if len(names) > 1:
        raise ConfigError(f"{' and '.join(names)}: give one of them")
    if person:
        without_effect({f"camera's option {' '.join(more or [])}": more}, "with --person")
    if seconds is not None and not 0 < seconds <= MAX_SECONDS:
        raise ConfigError(f"--seconds {seconds}: give a number above 0, up to {MAX_SECONDS:.0f}")
    check_viser()
    check_port(ScreenSettings("viewer", VIEWER, viewer))
    place = None if robot is None else place_of(robot)
    shown = screens(viewer, None, LOOPBACK, opened=None if no_browser else open_page)
    options = Options(duration_s=seconds)
    if not person:
        asked = [camera] if camera is not None else []
        asked = [str(video), AGAIN] if video is not None else asked
        words = [*(asked or [FIRST_CAMERA]), *SLOWER, *(more or [])]
        try:
            return _with_camera(words, place, options, shown)
        except _NotStarted as error:
            if asked or more:
                played = "" if video is not None else "--video FILE plays a video, "
                raise SourceError(f"{error}; {played}--person shows the demo's person") from None
            print(f"no camera: {error}; showing the demo's person instead", file=sys.stderr)
    return go(with_person(place or Place(0.0, 0.0)), options, False, shown)


class _NotStarted(Exception):
    """Raised if the camera's process sent no scene."""


def _with_camera(
    words: list[str],
    place: Place | None,
    options: Options,
    shown: AbstractContextManager[Feed | None],
) -> None:
    """Run the node with people from a camera until either exits.

    Raises:
        _NotStarted: the camera's process exited or timed out before the first scene.
        SourceError: it exited later, before the node.
    """
    stop = threading.Event()
    with Camera(words, stop.set) as process:
        try:
            process.wait()
        except SourceError as error:
            raise _NotStarted(str(error)) from None
        config = with_camera(
            place or BESIDE_THE_VIEW, process.port, process.key_file, repeats=AGAIN in words
        )
        go(config, options, False, shown, stop=stop)
        if process.process.poll():
            raise SourceError(process.reason())


def open_page(url: str) -> None:
    """Open a page silently in the user's browser, if there is a display."""
    if sys.platform not in ("darwin", "win32") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return
    with contextlib.suppress(OSError):  # the address was printed
        subprocess.Popen(
            [sys.executable, "-m", "webbrowser", url],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # it stays when this ends
        )
