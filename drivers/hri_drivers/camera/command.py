"""``camera``: find people with a camera, and send them to a node."""

import contextlib
import importlib
import json
import math
import re
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hri_predict.base.errors import ConfigError, SourceError
from hri_predict.cli.common import need_extra, one_of, warn, without_effect

if TYPE_CHECKING:
    from hri_drivers.camera.network.found import Finder
    from hri_drivers.camera.pipeline import Pipeline

PORT = 47_800  # of the source udp
MAX_THREADS = 16
VARIANTS = ("lite", "full", "heavy")


def camera(
    *,
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="INPUT",
            help="A camera's number (0) or device, 'realsense', 'oak', 'kinect', a video, a "
            "picture, or a folder of pictures.",
        ),
    ] = None,
    fetch_model: Annotated[
        bool, typer.Option("--fetch-model", help="Fetch the network by npm, once, and stop.")
    ] = False,
    model: Annotated[
        Path | None,
        typer.Option(
            help="The network: the npm package as .tgz, or a description (.yaml) of another."
        ),
    ] = None,
    variant: Annotated[
        str | None, typer.Option(help="lite, full or heavy network.", show_default="full")
    ] = None,
    people: Annotated[int, typer.Option(min=1, max=4, help="Follow this many people.")] = 4,
    host: Annotated[str, typer.Option(help="IP address of the node.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="UDP port of the node's source.")
    ] = PORT,
    key_file: Annotated[
        Path | None, typer.Option(help="A copy of the node's source.key_file.")
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(help="The camera's file, of 'camera-calibration'.")
    ] = None,
    field_of_view: Annotated[
        float | None,
        typer.Option(help="Horizontal field of view, degrees, of a camera without a file."),
    ] = None,
    height: Annotated[
        float | None, typer.Option(help="Height in metres, in shoes, of everyone in the picture.")
    ] = None,
    size: Annotated[
        str | None, typer.Option(help="Picture size to ask a camera for.", show_default="640x480")
    ] = None,
    fps: Annotated[
        float | None, typer.Option(help="Pictures per second of the input, instead of its own.")
    ] = None,
    latency: Annotated[
        float | None,
        typer.Option(help="Seconds from exposure to arrival, if the camera stamps no time."),
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Begin a video or folder again.")] = False,
    max_fps: Annotated[
        float | None, typer.Option(help="Send at most this many scenes per second.")
    ] = None,
    threads: Annotated[
        int, typer.Option(min=1, max=MAX_THREADS, help="Threads that compute the network.")
    ] = 1,
    once: Annotated[bool, typer.Option("--once", help="Stop after one picture.")] = False,
    seconds: Annotated[float | None, typer.Option(help="Stop after this many seconds.")] = None,
    preview: Annotated[
        Path | None, typer.Option(help="At the end, draw the people into the last picture.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON.")] = False,
) -> None:
    """Find people with a camera, a video or pictures, and send them to a node.

    One camera sees no free space: without a person in the picture, the node
    is sent that the room is not seen.

    Example: hri-predict camera 0 --preview me.png
    """
    need_extra("cv2", "camera")
    try:
        importlib.import_module("cv2")
    except ImportError as error:
        raise ConfigError(
            f"OpenCV cannot be loaded: {error}; pip install --force-reinstall "
            f"opencv-python-headless"
        ) from error
    from hri_drivers.camera import preview as drawing
    from hri_drivers.camera.depth_camera import DepthCamera
    from hri_drivers.camera.images import open_input
    from hri_drivers.camera.network import package
    from hri_drivers.camera.newest import Newest
    from hri_drivers.camera.pipeline import Pipeline
    from hri_drivers.camera.place.camera import read_camera
    from hri_drivers.camera.placing import Placer
    from hri_drivers.camera.sending import Sender
    from hri_drivers.sources.scene_stream.key_file import read_key
    from hri_predict.contracts.joint_map import load_joint_map

    if fetch_model:
        without_effect({"INPUT": source, "--model": model}, "with --fetch-model")
        path = package.fetch()
        print(f"{path}\nSHA-256 {package.SHA256}")
        return
    if source is None:
        raise ConfigError(
            "camera: give an input: a camera's number such as 0, a video, a picture or a folder"
        )
    for flag, value, most in (
        ("--fps", fps, 1000.0), ("--max-fps", max_fps, 1000.0), ("--seconds", seconds, 1e9),
        ("--latency", latency, 2.0),
    ):  # fmt: skip
        _within(flag, value, most)
    if calibration is not None:
        without_effect({"--field-of-view": field_of_view}, "with --calibration")
    if preview is not None:
        drawing.check(preview)
    known = None if calibration is None else read_camera(calibration)
    Placer(known, field_of_view, height)  # a mistake shows before a camera is opened
    key = None if key_file is None else read_key(str(key_file))
    pictures = open_input(
        source, rate_hz=fps, loop=loop, latency_s=latency, size=size_of(size, source)
    )
    if known is None and field_of_view is None and isinstance(pictures, DepthCamera):
        known = pictures.camera
    placer = Placer(known, field_of_view, height)
    finder = finder_of(model, variant, people, threads, flat=isinstance(pictures, DepthCamera))
    sender = Sender(host, port, load_joint_map(finder.layout).source_joints, key)
    pipeline = Pipeline(Newest(pictures), finder, placer, sender=sender, max_hz=max_fps)
    _run(pipeline, seconds, once)
    sender.close()
    if preview is not None and pipeline.last is not None:
        drawing.write(preview, *pipeline.last)
    summary = pipeline.summary()
    print(json.dumps(summary)) if as_json else _print(summary)
    if not summary["pictures"]:
        why = pipeline.trouble or "check the input"
        raise SourceError(f"input {source}: no picture came; {why}")


def _run(pipeline: "Pipeline", seconds: float | None, once: bool) -> None:
    """Run until the input ends, the time is over, or SIGINT or SIGTERM comes."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with contextlib.suppress(KeyboardInterrupt):
            pipeline.run(seconds, once)
    finally:
        pipeline.close()
        signal.signal(signal.SIGTERM, before)


def finder_of(
    model: Path | None, variant: str | None, people: int, threads: int, *, flat: bool
) -> "Finder":
    """Return the network of ``--model``.

    Args:
        flat: whether one that finds joints in the picture only is enough.

    Raises:
        ConfigError: it is missing or wrong, or is not enough.
    """
    from hri_drivers.camera.network import package
    from hri_drivers.camera.network.blazepose import BlazePose
    from hri_drivers.camera.network.described import DescribedNetwork
    from hri_drivers.camera.network.runtime import load_net

    path = package.kept_at() if model is None else model
    if path.suffix.lower() in (".yaml", ".yml"):
        without_effect({"--variant": variant}, f"with --model {path}")
        described = DescribedNetwork(path, people, threads)
        if not (described.has_world or flat):
            raise ConfigError(
                f"model {path}: it finds joints in the picture only, and one camera then cannot "
                f"say how far away a person is; name an output with metres as people.world"
            )
        if described.room_for == 1:
            warn(
                f"model {path}: it looks for one person, so a second one is not noticed: scenes "
                f"never say that the room is seen, and the advice stays unknown"
            )
        return described
    if path.suffix.lower() in (".onnx", ".tflite"):
        raise ConfigError(
            f"--model {path}: describe the network in a .yaml file, and give that file; "
            f"docs/guides/camera.md says how"
        )
    chosen = one_of("--variant", variant or "full", VARIANTS)
    detector, landmarks, digest = package.read(path, chosen)
    print(f"model: {path}, {chosen}, SHA-256 {digest}", file=sys.stderr)
    if digest != package.SHA256 and model is None:
        raise ConfigError(
            f"model {path}: damaged, or exchanged since it was fetched; run '{package.COMMAND}'"
        )
    if digest != package.SHA256:
        warn(f"model {path}: not the package that was tested ({package.NAME})")
    return BlazePose(
        load_net(detector, f"{path}: detector", threads),
        load_net(landmarks, f"{path}: {chosen}", threads),
        people,
    )


def _within(flag: str, value: float | None, most: float) -> None:
    if value is not None and not (0 < value <= most and math.isfinite(value)):
        raise ConfigError(f"{flag} {value:g}: give a number above 0, at most {most:g}")


def size_of(size: str | None, source: str) -> tuple[int, int]:
    """Return width and height of ``--size``."""
    if size is None:
        return 640, 480
    from hri_drivers.camera.images import DEPTH_CAMERAS, is_device

    if not (is_device(source) or source in DEPTH_CAMERAS):
        without_effect({"--size": size}, f"on {source}: only on a camera")
    found = re.fullmatch(r"(\d{2,4})x(\d{2,4})", size)
    if found is None:
        raise ConfigError(f"--size {size}: give WIDTHxHEIGHT in pixels, such as 640x480")
    return int(found[1]), int(found[2])


def _print(summary: dict[str, Any]) -> None:
    latency = summary["latency_ms"]
    print(
        f"pictures: {summary['pictures']}, {summary['dropped']} more dropped for newer ones, "
        f"{summary['skipped']} skipped for --max-fps, {summary['late']} too late for the order, "
        f"{summary['interruptions']} interruptions"
    )
    print(
        f"scenes: {summary['scenes']} sent, {summary['unsent']} datagrams refused by the system, "
        f"the clock was set {summary['clock_steps']} times"
    )
    print(f"people: {summary['ids']} ids, {summary['most_people']} at once at most")
    for what in ("unplaced", "without_view"):
        for why, count in summary[what].items():
            print(f"  {what.replace('_', ' ')}: {why}: {count}")
    if latency["p50"] is not None:
        print(
            f"latency from exposure to scene: {latency['least']:.0f} ms at least, "
            f"{latency['p50']:.0f} ms in the middle (p50), {latency['p99']:.0f} ms (p99), by "
            f"{summary['stamps']}; processor time for a picture: {summary['processor_ms']:.0f} ms"
        )
        print(
            f"the node needs source.min_latency_s: {latency['least'] / 1e3:.3f}, or every age is "
            f"too small by what is missing"
        )
