"""What every motion file becomes: scenes, in time, and how they are put into the room."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hri_predict.joint_map import JointMap
from hri_predict.link import Received
from hri_predict.scene import Bools, Floats, Person, Scene
from hri_predict.settings import Pose, transform
from hri_predict.skeleton import JOINTS

# Heading of a recording's start: the way first travelled, if it is long enough to be one.
HEADING_WINDOW_S = 1.0
HEADING_TRAVEL_M = 0.3


@dataclass(frozen=True, eq=False)
class Recording:
    """A motion file, read.

    Attributes:
        path: the file.
        kind: "cmu", "assembly", "bvh" or "mcap".
        joint_map: names of the source's joints and how they become canonical ones.
        rate_hz: nominal scenes per second.
        scenes: in the order of arrival; joints in metres, z up, in the file's own frame ("mcap": in
            the room's frame, as recorded). ``capture_ns`` counts from 0 at the file's first frame
            ("mcap": the clock of the recorded source).
        arrival_ns: (N,) when each scene arrives; the same as its capture, but for "mcap", where it
            is the recorded receipt.
        declares_noise: see ``source.Source``.
        received: what controllers sent while it was recorded: (link, message); "mcap" alone.
        note: something the user should know, such as where a cut file was cut; "" if nothing.
        config: text of the recording node's configuration; "mcap" alone.
    """

    path: Path
    kind: str
    joint_map: JointMap
    rate_hz: float
    scenes: Sequence[Scene]
    arrival_ns: Sequence[int]
    declares_noise: bool = False
    received: Sequence[tuple[str, Received]] = ()
    note: str = ""
    config: str = ""

    @property
    def duration_s(self) -> float:
        """From the first to the last arrival."""
        return (self.arrival_ns[-1] - self.arrival_ns[0]) * 1e-9


def scenes_of_one(positions: Floats, observed: Bools, rate_hz: float, person: int) -> list[Scene]:
    """Scenes of one person from (F, J, 3) metres and (F, J); not observed becomes NaN."""
    positions = np.where(observed[..., None], positions, np.nan)
    return [
        Scene(round(k * 1e9 / rate_hz), k, True, (Person(person, positions[k], observed[k]),))
        for k in range(len(positions))
    ]


def placed(
    recording: Recording, room_from_source: Pose, place: Sequence[float] | None
) -> Recording:
    """Put a recording into the room.

    ``room_from_source`` is the pose of the file's frame in the room; the scenes of an "mcap" stand
    in the room already, and it is not applied to them. ``place`` (x, y, yaw) then moves everything
    over the floor so that the recording's *start* is at x, y, with its heading along yaw: the start
    is where the waist, or else the middle of what was observed, first was; the heading is the way
    travelled in the first second if that is 0.3 m or more, and else where the body faces.
    """
    matrix = np.eye(4) if recording.kind == "mcap" else room_from_source.matrix()
    moved = _moved(recording, matrix)
    if place is None:
        return moved
    anchor, heading = start_of(moved)
    x, y, yaw = place
    turn = yaw - heading
    planar = np.eye(4)
    planar[:2, :2] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
    planar[:2, 3] = np.array([x, y]) - planar[:2, :2] @ anchor
    return _moved(moved, planar)


def _moved(recording: Recording, matrix: Floats) -> Recording:
    if np.array_equal(matrix, np.eye(4)):
        return recording
    scenes = [
        replace(
            scene,
            people=tuple(
                replace(p, positions=transform(matrix, p.positions)) for p in scene.people
            ),
        )
        for scene in recording.scenes
    ]
    return replace(recording, scenes=scenes)


def start_of(recording: Recording) -> tuple[Floats, float]:
    """Where the first person of a recording starts: (2,) metres on the floor, and heading (rad)."""
    anchor: Floats | None = None
    person_id, start_ns, facing = -1, 0, 0.0
    for scene in recording.scenes:
        for person in scene.people:
            if anchor is not None and person.id != person_id:
                continue
            joints, seen = recording.joint_map.map(person.positions, person.observed)
            here = _middle(joints, seen)
            if here is None:
                continue
            if anchor is None:
                anchor, person_id, start_ns = here, person.id, scene.capture_ns
                facing = _facing(joints, seen)
            travel = here - anchor
            if np.hypot(*travel) >= HEADING_TRAVEL_M:
                return anchor, math.atan2(travel[1], travel[0])
        if anchor is not None and scene.capture_ns - start_ns > HEADING_WINDOW_S * 1e9:
            break
    return (np.zeros(2) if anchor is None else anchor), facing


def _middle(joints: Floats, seen: Bools) -> Floats | None:
    """The waist on the floor, or else the middle of the shoulders, or of whatever was seen."""
    waist, left, right = (JOINTS.index(n) for n in ("waist", "l_shoulder", "r_shoulder"))
    if seen[waist]:
        chosen = joints[[waist]]
    elif seen[left] and seen[right]:
        chosen = joints[[left, right]]
    elif seen.any():
        chosen = joints[seen]
    else:
        return None
    middle: Floats = chosen[:, :2].mean(axis=0)
    return middle


def _facing(joints: Floats, seen: Bools) -> float:
    """Where a body faces: ahead of the line through its hips, or else its shoulders, ..."""
    for part in ("hip", "shoulder", "elbow", "wrist"):
        left, right = JOINTS.index(f"l_{part}"), JOINTS.index(f"r_{part}")
        if seen[left] and seen[right]:
            across = joints[left] - joints[right]  # to the left; ahead is a quarter turn clockwise
            return math.atan2(-across[0], across[1])
    return 0.0
