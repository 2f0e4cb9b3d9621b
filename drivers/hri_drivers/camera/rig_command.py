"""``cameras``: find people with several calibrated cameras, and send them to a node."""

import contextlib
import json
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import JsonOption, need_extra

if TYPE_CHECKING:
    from hri_drivers.camera.rig import Rig

MAX_CAMERAS = 4


def cameras(
    *,
    sources: Annotated[
        list[str],
        typer.Argument(metavar="INPUT...", help="Cameras' numbers or devices, or videos."),
    ],
    calibration: Annotated[
        list[Path],
        typer.Option(help="The file of each camera, in the same order, with its pose. Repeatable."),
    ],
    model: Annotated[
        Path | None, typer.Option(help="The network, as 'hri-predict camera' takes it.")
    ] = None,
    variant: Annotated[
        str | None, typer.Option(help="lite, full or heavy network.", show_default="full")
    ] = None,
    people: Annotated[int, typer.Option(min=1, max=4, help="Follow this many people.")] = 4,
    host: Annotated[str, typer.Option(help="IP address of the node.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="UDP port of the node's source.")
    ] = 47_800,
    key_file: Annotated[
        Path | None, typer.Option(help="A copy of the node's source.key_file.")
    ] = None,
    size: Annotated[
        str | None, typer.Option(help="Picture size to ask cameras for.", show_default="640x480")
    ] = None,
    fps: Annotated[
        float | None, typer.Option(min=0.1, max=1000, help="Pictures per second to ask for.")
    ] = None,
    threads: Annotated[
        int, typer.Option(min=1, max=16, help="Threads that compute the network.")
    ] = 1,
    seconds: Annotated[
        float | None, typer.Option(min=0.1, max=1e9, help="Stop after this many seconds.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find people with two to four calibrated cameras of one room, and send them to a node.

    People are in the axes of the first camera: room_from_source of the node is its
    pose.

    Example: hri-predict cameras 0 2 --calibration left.yaml --calibration right.yaml
    """
    need_extra("cv2", "camera")
    from hri_drivers.camera.command import finder_of, size_of
    from hri_drivers.camera.images import Video, open_input
    from hri_drivers.camera.newest import Newest
    from hri_drivers.camera.place.camera import read_camera
    from hri_drivers.camera.rig import Eye, Rig
    from hri_drivers.camera.sending import Sender
    from hri_drivers.sources.scene_stream.key_file import read_key
    from hri_predict.contracts.joint_map import load_joint_map

    if not 2 <= len(sources) <= MAX_CAMERAS or len(set(sources)) != len(sources):
        raise ConfigError(
            f"cameras: give 2 to {MAX_CAMERAS} different inputs; 'hri-predict camera' takes one"
        )
    if len(calibration) != len(sources):
        raise ConfigError(
            f"--calibration: given {len(calibration)} times for {len(sources)} inputs; give one "
            f"for each, in the same order"
        )
    known = [read_camera(path) for path in calibration]
    for path, camera in zip(calibration, known, strict=True):
        if camera.pose is None:
            raise ConfigError(
                f"--calibration {path}: has no pose in the room; find it with 'hri-predict "
                f"camera-calibration pose'"
            )
    key = None if key_file is None else read_key(str(key_file))
    finders = [finder_of(model, variant, people, threads, flat=True) for _ in sources]
    sender = Sender(host, port, load_joint_map(finders[0].layout).source_joints, key)
    inputs = [
        open_input(each, rate_hz=fps, loop=False, latency_s=None, size=size_of(size, each))
        for each in sources
    ]
    at_s = time.monotonic()
    for each in inputs:
        if isinstance(each, Video):
            each.begin(at_s)
    eyes = [
        Eye(source, Newest(each), finder, camera)
        for source, each, finder, camera in zip(sources, inputs, finders, known, strict=True)
    ]
    rig = Rig(eyes, sender=sender)
    _run(rig, seconds)
    sender.close()
    print(json.dumps(rig.summary())) if as_json else _print(rig.summary())


def _run(rig: "Rig", seconds: float | None) -> None:
    """Run until an input ends, the time is over, or SIGINT or SIGTERM comes."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with contextlib.suppress(KeyboardInterrupt):
            rig.run(seconds)
    finally:
        rig.close()
        signal.signal(signal.SIGTERM, before)


def _print(summary: dict[str, Any]) -> None:
    print(f"scenes: {summary['scenes']}; pictures without their pair: {summary['unpaired']}")
    for what in ("unplaced", "without_view"):
        for why, count in summary[what].items():
            print(f"  {what.replace('_', ' ')}: {why}: {count}")
    latency = summary["latency_ms"]
    if latency["p50"] is not None:
        print(
            f"latency from exposure to scene: {latency['least']:.0f} ms at least, "
            f"{latency['p50']:.0f} ms in the middle (p50), {latency['p99']:.0f} ms (p99)"
        )
        print(
            f"the node needs source.min_latency_s: {latency['least'] / 1e3:.3f}, or every age is "
            f"too small by what is missing"
        )
