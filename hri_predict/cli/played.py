"""The source that replays a recording in a cell."""

from pathlib import Path
from typing import Any

from hri_predict.contracts.source import SourceSettings
from hri_predict.recording.ros.bag import BAG_ENDING, file_of, is_ros_mcap

BESIDE_THE_ROBOT = [-1.9, 2.0, 0.0]  # default place where a recording starts


def played(cell: SourceSettings, recording: Path) -> dict[str, Any]:
    """Return ``source:`` of a recording in place of a cell's own.

    A motion file starts beside the robot. This node's own recording is in the room already. A bag
    of the cell's own topic is read as the cell reads the topic.

    Args:
        cell: the configuration's source.
        recording: the file.
    """
    path = str(recording.absolute())
    if cell.kind == "recording":
        return cell.model_dump() | {"path": path}
    view = cell.field_of_view
    source: dict[str, Any] = {
        "kind": "recording",
        "path": path,
        "room_from_source": cell.room_from_source.model_dump(),
        "min_latency_s": cell.min_latency_s,
        "clock_wander_s": cell.clock_wander_s,
        "stale_s": cell.stale_s,
        "field_of_view": None if view is None else view.model_dump(),
    }
    if cell.kind == "ros2" and _is_bag(recording):
        own = cell.model_dump(include={"joint_map", "axes", "frame"})
        topics: list[str] = getattr(cell, "topics", [])
        return source | own | ({"topic": topics[0]} if len(topics) == 1 else {})
    if recording.suffix != ".mcap" or _is_bag(recording):
        source["place"] = BESIDE_THE_ROBOT
    return source


def _is_bag(recording: Path) -> bool:
    file = file_of(recording)
    if file.suffix in (BAG_ENDING, ".db3"):
        return True
    return file.suffix == ".mcap" and file.is_file() and is_ros_mcap(file)
