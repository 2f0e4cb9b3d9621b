"""``camera``: find people with a camera, and send them to a node."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hri_drivers.camera.options import (
    DEFAULT_SIZE,
    MAX_HZ,
    MAX_SECONDS,
    PORT,
    WIDE_SIZE,
    HostOption,
    KeyFileOption,
    ModelOption,
    PeopleOption,
    PortOption,
    SecondsOption,
    SizeOption,
    ThreadsOption,
    VariantOption,
    need_cv2,
    print_scenes,
    size_of,
    until_signal,
    within,
)
from hri_predict.base.errors import ConfigError, SourceError
from hri_predict.cli.common import JsonOption, one_of, warn, without_effect

if TYPE_CHECKING:
    from hri_drivers.camera.network.found import Finder

MAX_LATENCY_S = 2.0
VARIANTS = ("lite", "full", "heavy")


def camera(
    *,
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="INPUT",
            help="A camera's number (0) or device, 'realsense', 'oak', 'kinect', a video, an "
            "image, or a folder of images.",
        ),
    ] = None,
    fetch_model: Annotated[
        bool, typer.Option("--fetch-model", help="Fetch the network with npm, once, and exit.")
    ] = False,
    model: ModelOption = None,
    variant: VariantOption = None,
    people: PeopleOption = 4,
    host: HostOption = "127.0.0.1",
    port: PortOption = PORT,
    key_file: KeyFileOption = None,
    calibration: Annotated[
        Path | None, typer.Option(help="Camera file written by 'camera-calibration'.")
    ] = None,
    field_of_view: Annotated[
        float | None,
        typer.Option(
            help="Field of view along the longer side of the images in use, degrees, of a camera "
            "without a file. Without --size, 640x360 is requested: data sheets give the angle of "
            "16:9 images."
        ),
    ] = None,
    height: Annotated[
        float | None, typer.Option(help="Height in metres, in shoes, of everyone in the image.")
    ] = None,
    size: SizeOption = None,
    fps: Annotated[
        float | None, typer.Option(help="Images per second of the input, instead of its own.")
    ] = None,
    latency: Annotated[
        float | None,
        typer.Option(help="Seconds from exposure to arrival, if the camera sends no time stamps."),
    ] = None,
    loop: Annotated[
        bool, typer.Option("--loop", help="Restart a video or folder at its end.")
    ] = False,
    max_fps: Annotated[
        float | None, typer.Option(help="Send at most this many scenes per second.")
    ] = None,
    threads: ThreadsOption = 1,
    once: Annotated[bool, typer.Option("--once", help="Stop after one image.")] = False,
    seconds: SecondsOption = None,
    preview: Annotated[
        Path | None,
        typer.Option(help="At the end, save the last image with the people drawn in."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find people with a camera, a video or images, and send them to a node.

    One camera cannot show that space is free: without a person in the image, its scenes report
    that the room is not seen.

    Example: hri-predict camera 0 --preview me.png
    """
    need_cv2()
    from hri_drivers.camera import preview as drawing
    from hri_drivers.camera.depth_camera import DepthCamera
    from hri_drivers.camera.images import check_input, is_depth_camera, open_input
    from hri_drivers.camera.network import package
    from hri_drivers.camera.newest import Newest
    from hri_drivers.camera.pipeline import Pipeline
    from hri_drivers.camera.place.camera import read_camera
    from hri_drivers.camera.placing import Placer
    from hri_drivers.camera.sending import Sender, address_of
    from hri_drivers.sources.scene_stream.key_file import read_key
    from hri_predict.contracts.joint_map import load_joint_map

    if fetch_model:
        without_effect({"INPUT": source, "--model": model}, "with --fetch-model")
        path = package.fetch()
        print(f"{path}\nSHA-256 {package.SHA256}")
        return
    if source is None:
        raise ConfigError(
            "camera: give an input: a camera's number such as 0, a video, an image or a folder"
        )
    for flag, value, most in (
        ("--fps", fps, MAX_HZ), ("--max-fps", max_fps, MAX_HZ), ("--seconds", seconds, MAX_SECONDS),
        ("--latency", latency, MAX_LATENCY_S),
    ):  # fmt: skip
        within(flag, value, most)
    if calibration is not None:
        without_effect({"--field-of-view": field_of_view}, "with --calibration")
    if preview is not None:
        drawing.check(preview)
    known = None if calibration is None else read_camera(calibration)
    placer = Placer(known, field_of_view, height)
    key = None if key_file is None else read_key(str(key_file))
    address_of(host, key)
    check_input(source, loop=loop, latency_s=latency)
    wanted = size_of(size, source, known, DEFAULT_SIZE if field_of_view is None else WIDE_SIZE)
    # the network first: while it is loaded, images of an open camera would grow old
    finder = finder_of(model, variant, people, threads, flat=is_depth_camera(source))
    pictures = open_input(source, rate_hz=fps, loop=loop, latency_s=latency, size=wanted)
    if known is None and field_of_view is None and isinstance(pictures, DepthCamera):
        placer.calibrate(pictures.camera)
    sender = Sender(host, port, load_joint_map(finder.layout).source_joints, key)
    stands = pictures.camera if known is None and isinstance(pictures, DepthCamera) else known
    pipeline = Pipeline(
        Newest(pictures), finder, placer, sender=sender, max_hz=max_fps, stands=stands
    )
    until_signal(lambda: pipeline.run(seconds, once), pipeline.close)
    sender.close()
    if preview is not None and pipeline.last is not None:
        drawing.write(preview, *pipeline.last)
    summary = pipeline.summary()
    print(json.dumps(summary)) if as_json else _print(summary)
    if not summary["pictures"]:
        why = pipeline.trouble or "check the input"
        raise SourceError(f"input {source}: no image arrived; {why}")


def finder_of(
    model: Path | None, variant: str | None, people: int, threads: int, *, flat: bool
) -> "Finder":
    """Return the network of ``--model``.

    Args:
        flat: whether a network that finds joints in the image only is sufficient.

    Raises:
        ConfigError: the model is missing, wrong or not sufficient.
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
                f"model {path}: it finds joints in the image only, so one camera cannot "
                f"measure the distance to a person; name an output with metres as people.world"
            )
        if described.room_for == 1:
            warn(
                f"model {path}: it finds one person only and would miss a second one: scenes "
                f"never report the room as seen, and the advice stays unknown"
            )
        return described
    if path.suffix.lower() in (".onnx", ".tflite"):
        raise ConfigError(
            f"--model {path}: describe the network in a .yaml file, and give that file; "
            f"docs/guides/camera.md explains how"
        )
    chosen = one_of("--variant", variant or "full", VARIANTS)
    detector, landmarks, digest = package.read(path, chosen)
    print(f"model: {path}, {chosen}, SHA-256 {digest}", file=sys.stderr)
    if digest != package.SHA256:
        warn(f"model {path}: not the package that was tested ({package.NAME})")
    return BlazePose(
        load_net(detector, f"{path}: detector", threads),
        load_net(landmarks, f"{path}: {chosen}", threads),
        people,
    )


def _print(summary: dict[str, Any]) -> None:
    print(
        f"images: {summary['pictures']}, {summary['dropped']} more dropped for newer ones, "
        f"{summary['skipped']} skipped for --max-fps, {summary['interruptions']} interruptions"
    )
    print(f"people: {summary['ids']} ids, at most {summary['most_people']} at a time")
    if summary["processor_ms"] is not None:
        print(f"processor time per image: {summary['processor_ms']:.0f} ms")
    print_scenes(summary, summary["stamps"])
