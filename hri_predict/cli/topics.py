"""``topics``: list the topics of a ROS bag that could contain people."""

import json
import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from hri_predict.base.errors import RecordingError
from hri_predict.cli.common import JsonOption

if TYPE_CHECKING:
    from hri_predict.recording.ros.topics import BagTopic


def topics(
    *,
    bag: Annotated[
        Path, typer.Argument(help="A ROS bag: .bag, .db3, .mcap, or the folder of a ROS 2 bag.")
    ],
    as_json: JsonOption = False,
) -> None:
    """List the topics of a ROS bag that could contain people, with the options to replay each.

    Example: hri-predict topics walk.bag
    """
    if not bag.exists():
        raise RecordingError(f"recording {bag}: no such file; check the path")
    from hri_predict.recording.ros.bag import file_of  # needs rosbags: a wrong path is said first
    from hri_predict.recording.ros.topics import topics_of

    try:
        found = topics_of(file_of(bag))
    except OSError as error:
        raise RecordingError(
            f"recording {bag}: cannot be read: {error.strerror or error}"
        ) from error
    rows = [asdict(each) | {"options": _options(each)} for each in found]
    if as_json:
        print(json.dumps({"bag": str(bag), "topics": rows}))
        return
    if not rows:
        print(f"{bag}: no topic can contain people (PoseArray, MarkerArray, ROS4HRI, ZED)")
        return
    _show(bag, found)


def _options(topic: "BagTopic") -> list[str]:
    """Options for ``replay`` and ``convert``; the joint map only if exactly one fits."""
    options = [] if topic.is_named else ["--topic", topic.name]
    return [*options, "--joint-map", topic.joint_maps[0]] if len(topic.joint_maps) == 1 else options


def _show(bag: Path, found: "list[BagTopic]") -> None:
    table = Table(title=f"Topics of {bag} that could be people", title_justify="left")
    for heading in ("topic", "type", "messages", "joints", "frame", "matching joint maps"):
        table.add_column(heading, overflow="fold")
    for each in found:
        cells = (
            each.name,
            each.kind.rsplit("/", 1)[-1],
            str(each.count),
            str(each.joints or "-"),
            each.frame or "-",
            "named in the bag" if each.is_named else ", ".join(each.joint_maps) or "-",
        )
        table.add_row(*cells)
    Console().print(table)
    for each in found:
        words = ["hri-predict", "replay", str(bag), *_options(each)]
        if len(each.joint_maps) != 1 and not each.is_named:
            words += ["--joint-map", each.joint_maps[0] if each.joint_maps else "FILE.yaml"]
        print(f"to see it: {shlex.join([*words, '--viewer', '0'])}")
