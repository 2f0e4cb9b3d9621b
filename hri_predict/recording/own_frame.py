"""Units and axes of dumps that state none, if the joints' names identify the tracker.

A table of Azure Kinect is in millimetres, y down; FreeMoCap writes the same names as MediaPipe, but
millimetres, z up. Among the frames of such trackers, the one in which people are of human size and
stand is chosen. The horizontal axis that points ahead is only a convention, because no body shows
the room's heading.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.joint_map import METRES_PER_UNIT, JointMap, load_joint_map, map_names
from hri_predict.recording.formats.csv_table import is_own_table
from hri_predict.recording.plausibility import check_possible, check_size
from hri_predict.recording.recording import Recording, noted, turned

KINDS = ("csv", "npy", "openpose", "3dpw")
UP = ("x", "y", "z"), ("x", "-z", "y"), ("z", "-x", "-y")
"""Axes that are forward, left and up: z up, y up, and a camera's (x right, y down, z away)."""
_UNITS = (1.0, 0.001)

Reopened = Callable[[float], Recording]


def in_own_frame(recording: Recording, reopened: Reopened) -> Recording:
    """Return the recording in the units and axes in which people stand, with a note if it changed.

    Unchanged are recordings that make sense as they are, of other formats, of unknown trackers,
    tables that this project wrote, whose units and axes are known (a person may lie there), and
    those that make no sense in any of these frames: ``check_possible`` says why.

    Args:
        recording: as its format's usual units and axes give it.
        reopened: reads the file again with other metres per unit.
    """
    name = recording.joint_map.name.removesuffix(" by name")
    known = name in map_names() and name not in ("bvh", "canonical")
    tracker = load_joint_map(name) if known else None
    if recording.kind not in KINDS or tracker is None:
        return recording
    if not _refused(recording, partial(check_possible, reopened=reopened)):
        return recording
    if recording.kind == "csv" and is_own_table(recording.path):
        return recording
    for unit_m in dict.fromkeys((recording.joint_map.scale_to_m, tracker.scale_to_m, *_UNITS)):
        same = unit_m == recording.joint_map.scale_to_m
        sized = recording if same else reopened(unit_m)
        if _refused(sized, check_size):
            continue
        for joint_map in _turns(sized.joint_map, tracker):
            found = turned(sized, joint_map)
            if not _refused(found, check_possible):
                return noted(found, _note(joint_map, name))
    return recording


def _refused(recording: Recording, check: Callable[[Recording], None]) -> str:
    try:
        check(recording)
    except RecordingError as error:
        return str(error)
    return ""


def _turns(own: JointMap, tracker: JointMap) -> list[JointMap]:
    rotations = [tracker.rotation, *(own.with_axes(axes).rotation for axes in UP)]
    return [replace(own, rotation=rotation) for rotation in rotations]


def _note(joint_map: JointMap, name: str) -> str:
    units = {scale: unit for unit, scale in METRES_PER_UNIT.items()}
    unit = units.get(joint_map.scale_to_m, f"{joint_map.scale_to_m:g} m")
    axes = []
    for row in joint_map.rotation:
        axis = int(np.argmax(np.abs(row)))
        axes.append(("-" if row[axis] < 0 else "") + "xyz"[axis])
    return (
        f"by the names of its joints ({name}) and by how people stand it is in {unit}, with "
        f"{','.join(axes)} forward, left and up (--units and --axes of convert say otherwise)"
    )
