"""``try``: see yourself, the forecast and a moving robot in 3D."""

import contextlib
import math
import os
import secrets
import select
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any

import typer
import yaml

from hri_predict.base.errors import ConfigError, SourceError
from hri_predict.base.files import data_path, read_yaml
from hri_predict.cli.common import without_effect
from hri_predict.cli.run import go
from hri_predict.cli.screens.options import screens
from hri_predict.run.config import Config, checked
from hri_predict.run.session import Options
from hri_predict.viewing.feed import VIEWER, Feed, check_viser
from hri_predict.viewing.screen import ScreenSettings, check_port

FARTHEST_M = 20.0
"""Maximum distance of the robot from the room's origin, along x and along y."""
ACKNOWLEDGED_S = 4.0
"""Time after which the simulated controllers acknowledge a lost person."""


@dataclass(frozen=True, slots=True)
class Place:
    """Pose of the robot: metres, and radians counter-clockwise from +x."""

    x: float
    y: float
    yaw: float = 0.0

    def moved(self, point: list[float]) -> list[float]:
        """Return a point [x, y] of the robot's frame in the room's frame."""
        x, y = point
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return [self.x + c * x - s * y, self.y + s * x + c * y]

    def pose(self) -> dict[str, list[float]]:
        """Return the block ``room_from_robot`` of a configuration."""
        turn = [0.0, 0.0, math.sin(self.yaw / 2), math.cos(self.yaw / 2)]
        return {"xyz": [self.x, self.y, 0.0], "quaternion_xyzw": turn}


def place_of(text: str) -> Place:
    """Return the pose given by ``--robot``.

    Raises:
        ConfigError: it is not two or three numbers, or too far away.
    """
    try:
        place = Place(*(float(part) for part in text.split(",")))
    except (ValueError, TypeError):
        raise ConfigError(
            f"--robot {text}: give X,Y or X,Y,YAW (m, m, rad), such as 1.5,0.8"
        ) from None
    if not (abs(place.x) <= FARTHEST_M and abs(place.y) <= FARTHEST_M):
        raise ConfigError(f"--robot {text}: x and y must be from -{FARTHEST_M:g} to {FARTHEST_M:g}")
    if not abs(place.yaw) <= 2 * math.pi:
        raise ConfigError(f"--robot {text}: the yaw must be from -6.28 to 6.28 rad")
    return place


def with_person(robot: Place) -> Config:
    """Return the demo's cell with the robot at ``robot``; exits and the person move with it."""
    data = _demo(robot)
    data["source"]["room_from_source"] = robot.pose()
    for region in data["people"]["exits"]:
        region["polygon"] = [robot.moved(corner) for corner in region["polygon"]]
    return _checked(data)


def with_camera(robot: Place, port: int, key_file: Path, *, repeats: bool = False) -> Config:
    """Return the shipped ``camera.yaml``, heard at a port of this machine, with the demo's robot.

    Its rate and predictor need less computing time than the demo's, because the computer also
    processes images.

    Args:
        robot: pose of the robot.
        port: UDP port of the source.
        key_file: with the source's key.
        repeats: whether the input is a looping video: repeated joints are then normal, while from a
            camera they mean that it is frozen.
    """
    data: dict[str, Any] = read_yaml(data_path("camera.yaml"), "configuration")
    data |= {key: value for key, value in _demo(robot).items() if key in ("robots", "links")}
    data["source"] |= {"port": port, "key_file": str(key_file), "declares_noise": not repeats}
    for link in data["links"]:
        link["simulate"]["acknowledge_after_s"] = ACKNOWLEDGED_S
    return _checked(data)


def _demo(robot: Place) -> dict[str, Any]:
    data: dict[str, Any] = read_yaml(data_path("demo.yaml"), "configuration")
    data["robots"][0]["room_from_robot"] = robot.pose()
    return data


def _checked(data: dict[str, Any]) -> Config:
    return checked(data_path("try.yaml"), yaml.safe_dump(data), data)


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


COMMAND = [sys.executable, "-m", "hri_predict.cli.tryout.beside", "camera"]
LOOPBACK = "127.0.0.1"
START_S = 60.0
"""Maximum time to the first scene: loading a network and opening a camera may take seconds."""
END_S = 3.0
"""Time after which a process that was asked to exit is killed."""
_KEY_BYTES = 32


class Camera:
    """The process of ``hri-predict camera``, ended when the context manager is left.

    Its scenes are authenticated by a key that is created for this process and deleted with it.

    Args:
        arguments: arguments of the command, besides host, port and key.
        ended: called in a separate thread if the process exits before it is closed.

    Attributes:
        port: the UDP port to which the process sends.
        key_file: the file with the key.
    """

    def __init__(self, arguments: Sequence[str], ended: Callable[[], None]) -> None:
        self._ended = ended
        self._closing = False
        self._lines: deque[str] = deque(maxlen=20)
        self._folder = tempfile.TemporaryDirectory(prefix="hri-predict-")
        self.key_file = Path(self._folder.name, "camera.key")
        self.key_file.touch(mode=0o600)
        self.key_file.write_text(secrets.token_hex(_KEY_BYTES), encoding="utf-8")
        self._probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._probe.bind((LOOPBACK, 0))
        self.port = int(self._probe.getsockname()[1])
        where = ["--host", LOOPBACK, "--port", str(self.port), "--key-file", str(self.key_file)]
        self.process = subprocess.Popen(
            [*COMMAND, *arguments, *where],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,  # a summary
            stderr=subprocess.PIPE,
            process_group=0,  # Ctrl-C is for the node, which ends this process in its turn
        )
        self._reader = threading.Thread(target=self._read, name="camera", daemon=True)
        self._reader.start()

    def wait(self) -> None:
        """Wait for the first scene; afterwards the port is free for the node.

        Raises:
            SourceError: the process exited first (the message is its own error), or sent nothing
                for ``START_S``.
        """
        end_s = time.monotonic() + START_S
        with self._probe:
            while not select.select([self._probe], [], [], 0.1)[0]:
                if self.process.poll() is not None:
                    raise SourceError(self.reason())
                if time.monotonic() > end_s:
                    raise SourceError(f"the camera sent nothing in {START_S:.0f} s")

    def reason(self) -> str:
        """Return why the process exited: its printed error, or its traceback's last line."""
        self._reader.join(END_S)
        lines = [line for line in self._lines if line]
        errors = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]
        if errors:
            return errors[-1]
        faulty = any(line.startswith("Traceback ") for line in lines)
        status = f"the camera's process ended (status {self.process.wait()})"
        return f"{status}: {lines[-1]}" if faulty else f"{status} without a reason"

    def _read(self) -> None:
        """Keep the last lines of the process; print all except errors and library messages."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            text = "".join(c for c in line.decode("utf-8", "replace") if c.isprintable()).strip()
            self._lines.append(text)
            if text and not text.startswith(("error: ", "INFO: ")):
                print(f"camera: {text.removeprefix('camera: ')}", file=sys.stderr, flush=True)
        self.process.wait()
        if not self._closing:
            self._ended()

    def __enter__(self) -> "Camera":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._closing = True
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            self.process.wait(END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join(END_S)
        self._probe.close()
        self._folder.cleanup()
