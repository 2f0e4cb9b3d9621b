"""Options of the commands ``camera`` and ``cameras``, their checks, and their common ending."""

import contextlib
import importlib
import math
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import need_extra, without_effect

if TYPE_CHECKING:
    from hri_drivers.camera.place.camera import Camera

PORT = 47_800  # of the source udp
MAX_THREADS = 16
DEFAULT_SIZE = 640, 480
WIDE_SIZE = 640, 360
"""Size to request for a stated field of view: data sheets give that of 16:9 images."""

ModelOption = Annotated[
    Path | None,
    typer.Option(
        "--model",
        help="The network: the npm package as .tgz, or a description (.yaml) of another.",
    ),
]
VariantOption = Annotated[
    str | None,
    typer.Option("--variant", help="lite, full or heavy network.", show_default="full"),
]
PeopleOption = Annotated[
    int, typer.Option("--people", min=1, max=4, help="Maximum number of people to follow.")
]
HostOption = Annotated[str, typer.Option("--host", help="IP address of the node.")]
PortOption = Annotated[
    int, typer.Option("--port", min=1, max=65535, help="UDP port of the node's source.")
]
KeyFileOption = Annotated[
    Path | None, typer.Option("--key-file", help="A copy of the node's source.key_file.")
]
SizeOption = Annotated[
    str | None,
    typer.Option(
        "--size",
        help="Image size to request from a camera.",
        show_default="that of its file, or 640x480",
    ),
]
ThreadsOption = Annotated[
    int,
    typer.Option(
        "--threads", min=1, max=MAX_THREADS, help="Number of threads that run the network."
    ),
]
SecondsOption = Annotated[
    float | None, typer.Option("--seconds", help="Stop after this many seconds.")
]
MAX_SECONDS, MAX_HZ = 1e9, 1000.0


def need_cv2() -> None:
    """Refuse to continue without OpenCV.

    Raises:
        ConfigError: OpenCV is not installed, or cannot be loaded.
    """
    need_extra("cv2", "camera")
    try:
        importlib.import_module("cv2")
    except ImportError as error:
        raise ConfigError(
            f"OpenCV cannot be loaded: {error}; reinstall it with: pip install "
            f"--force-reinstall opencv-python-headless"
        ) from error


def within(flag: str, value: float | None, most: float) -> None:
    """Refuse NaN, a number that is not above 0, and a number above ``most``.

    Raises:
        ConfigError: the message names the flag.
    """
    if value is not None and not (0 < value <= most and math.isfinite(value)):
        raise ConfigError(f"{flag} {value:g}: give a number above 0, at most {most:g}")


def size_of(
    size: str | None,
    source: str,
    known: "Camera | None",
    default: tuple[int, int] = DEFAULT_SIZE,
) -> tuple[int, int]:
    """Return the width and height to ask a camera for.

    Args:
        size: ``--size``; None: the size in the camera's file, or ``default``.
        source: the input.
        known: the calibrated camera.
        default: size for a camera without a file.

    Raises:
        ConfigError: the input is not a camera, or the camera was calibrated with other images.
    """
    if size is None:
        return default if known is None else known.size
    from hri_drivers.camera.images import is_depth_camera
    from hri_drivers.camera.webcam import is_device

    if not (is_device(source) or is_depth_camera(source)):
        without_effect({"--size": size}, f"on {source}: only on a camera")
    found = re.fullmatch(r"(\d{2,4})x(\d{2,4})", size)
    if found is None:
        raise ConfigError(f"--size {size}: give WIDTHxHEIGHT in pixels, such as 640x480")
    asked = int(found[1]), int(found[2])
    if known is not None:
        try:
            known.of_size(*asked)
        except ConfigError:
            raise ConfigError(
                f"--size {size}: the camera was calibrated with images of {known.size[0]} x "
                f"{known.size[1]}; leave out --size, or calibrate again with images of {size}"
            ) from None
    return asked


def until_signal(run: Callable[[], Any], close: Callable[[], Any]) -> None:
    """Run to the end or until SIGINT or SIGTERM arrives, then close."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with contextlib.suppress(KeyboardInterrupt):
            run()
    finally:
        close()
        signal.signal(signal.SIGTERM, before)


def print_scenes(summary: dict[str, Any], stamps: str) -> None:
    """Print the part of the summary that both commands share.

    Args:
        summary: summary of ``Pipeline`` or ``Rig``.
        stamps: how the times of the images are known.
    """
    print(
        f"scenes: {summary['scenes']}, {summary['late']} images too late for their order, "
        f"{summary['unsent']} datagrams refused by the system, the clock was set "
        f"{summary['clock_steps']} times"
    )
    for what in ("unplaced", "without_view"):
        for why, count in summary[what].items():
            print(f"  {what.replace('_', ' ')}: {why}: {count}")
    for name, counts in summary["background"].items():
        if counts["undecided"]:
            print(
                f"  {name}: in {counts['undecided']} of {counts['checks']} checks the background "
                f"had too few points: a camera moved at that time was not detected"
            )
    latency = summary["latency_ms"]
    if latency["least"] is None:
        return
    print(
        f"latency from exposure to scene: {latency['least']:.0f} ms minimum, "
        f"{latency['p50']:.0f} ms median (p50), {latency['p99']:.0f} ms (p99), by {stamps}"
    )
    print(
        f"the node needs source.min_latency_s: {latency['least'] / 1e3:.3f}; with less, every age "
        f"is too small by the difference"
    )
