"""``cameras``: find people with several calibrated cameras, and send them to a node."""

import json
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from hri_drivers.camera.options import (
    MAX_HZ,
    MAX_SECONDS,
    PORT,
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
from hri_predict.cli.common import JsonOption

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
    model: ModelOption = None,
    variant: VariantOption = None,
    people: PeopleOption = 4,
    host: HostOption = "127.0.0.1",
    port: PortOption = PORT,
    key_file: KeyFileOption = None,
    size: SizeOption = None,
    fps: Annotated[float | None, typer.Option(help="Images per second to request.")] = None,
    threads: ThreadsOption = 1,
    seconds: SecondsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Find people with two to four calibrated cameras of one room, and send them to a node.

    People are in the axes of the first camera: set the node's room_from_source to its pose.

    Example: hri-predict cameras 0 2 --calibration left.yaml --calibration right.yaml
    """
    need_cv2()
    from hri_drivers.camera.command import finder_of
    from hri_drivers.camera.images import Video, check_input, open_input
    from hri_drivers.camera.newest import Newest
    from hri_drivers.camera.place.camera import read_camera
    from hri_drivers.camera.rig import Eye, Rig
    from hri_drivers.camera.sending import Sender, address_of
    from hri_drivers.sources.scene_stream.key_file import read_key
    from hri_predict.contracts.joint_map import load_joint_map

    within("--fps", fps, MAX_HZ)
    within("--seconds", seconds, MAX_SECONDS)
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
                f"--calibration {path}: no pose in the room; find it with 'hri-predict "
                f"camera-calibration pose'"
            )
    key = None if key_file is None else read_key(str(key_file))
    address_of(host, key)
    for each in sources:
        check_input(each, loop=False, latency_s=None)
    wanted = [size_of(size, each, of) for each, of in zip(sources, known, strict=True)]
    finders = [finder_of(model, variant, people, threads, flat=True) for _ in sources]
    sender = Sender(host, port, load_joint_map(finders[0].layout).source_joints, key)
    inputs = [
        open_input(each, rate_hz=fps, loop=False, latency_s=None, size=pixels)
        for each, pixels in zip(sources, wanted, strict=True)
    ]
    at_s = time.monotonic()
    for pictures in inputs:
        if isinstance(pictures, Video):
            pictures.begin(at_s)
    eyes = [
        Eye(source, Newest(each), finder, camera)
        for source, each, finder, camera in zip(sources, inputs, finders, known, strict=True)
    ]
    rig = Rig(eyes, sender=sender)
    until_signal(lambda: rig.run(seconds), rig.close)
    sender.close()
    summary = rig.summary()
    print(json.dumps(summary)) if as_json else _print(summary)
    if not summary["scenes"]:
        raise SourceError(f"cameras: no images taken at the same time arrived; {rig.trouble}")


def _print(summary: dict[str, Any]) -> None:
    dropped = ", ".join(f"{count} of {name}" for name, count in summary["dropped"].items())
    print(f"images without a match: {summary['unpaired']}; dropped for newer ones: {dropped}")
    stamps = "; ".join(f"{how} ({name})" for name, how in summary["stamps"].items())
    print_scenes(summary, stamps)
