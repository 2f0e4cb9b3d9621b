"""Common form of motion files: timed scenes, and their placement in the room."""

import hashlib
import itertools
import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import RecordingError
from hri_predict.base.geometry import transform
from hri_predict.base.settings import MAX_COORDINATE_M, MAX_RATE_HZ, MIN_RATE_HZ, Pose
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.link import Received
from hri_predict.contracts.scene import Person, Scene

# Heading at a recording's start: the first direction of travel, if it is long enough.
HEADING_WINDOW_S = 1.0
HEADING_TRAVEL_M = 0.3
ARMS = "arms"
"""Action of the recordings of seated people's arms."""
SELF_EXPLAINED = ("cmu", "assembly", "motion", "mcap")  # kinds whose units and axes are fixed
MAX_GAP_S = 3600.0  # between two scenes; a node that waits longer would seem to hang


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """A motion file, read.

    Attributes:
        path: the file.
        kind: its format, such as "bvh" (``recording.format_table``), or the data pack's layout.
        joint_map: names of the source's joints and how they become canonical ones.
        rate_hz: nominal scenes per second.
        scenes: in the order of arrival; joints in metres, z up, in the file's own frame, or
            in the room's (``in_room``). ``stamp_ns`` counts from 0 at the file's first frame
            ("mcap": the clock of the recorded source).
        arrival_ns: (N,) when each scene arrives; the same as its capture, except in "mcap", where
            it is the recorded receipt.
        declares_noise: see ``source.Source``.
        received: messages of controllers during the recording: (link, message); "mcap" only.
        note: something the user should know, such as where a cut file was cut; "" if nothing.
        floor_m: height of the floor in the file; the reader took it off all heights.
        config: text of the recording node's configuration; "mcap" only.
        last_latch_id: see ``RecordingInfo``; "mcap" only.
        utc_ns: (N,) the arrivals in UTC, nanoseconds since 1970; empty if that is not known.
        in_room: whether the scenes are in the room's frame already: of this node's recordings, and
            bags made of them, that were not converted from a motion file.
        parts: all files of a recording that is several, each a frame; empty for a single file.
        outputs_ns: first and last moment, node's clock, of the node's output in the file that
            belongs to these scenes; "mcap" only, ``None``: none of it.
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
    floor_m: float = 0.0
    config: str = ""
    last_latch_id: int | None = None
    utc_ns: Sequence[int] = ()
    in_room: bool = False
    parts: Sequence[Path] = ()
    outputs_ns: tuple[int, int] | None = None

    @property
    def duration_s(self) -> float:
        """From the first to the last arrival."""
        return (self.arrival_ns[-1] - self.arrival_ns[0]) * 1e-9

    @property
    def action(self) -> str:
        """Action of the people, for tables: "arms" for the assembly recordings; the folder's name
        for those of ``motion``, whose folders are its sets; or else the name without its number.
        """
        if self.kind == "assembly":
            return ARMS
        return self.path.absolute().parent.name if self.kind == "motion" else action_of(self.path)

    @property
    def digest(self) -> str | None:
        """SHA-256 of its files, hexadecimal; ``None`` without a file."""
        if not self.path.is_file():
            return None
        found = hashlib.sha256()
        for path in self.parts or [self.path]:
            found.update(path.read_bytes())
        return found.hexdigest()


def action_of(path: Path) -> str:
    """A file's name without ending and trailing number: ``walking`` of ``walking_3.npz``."""
    stem, _, number = path.stem.rpartition("_")
    return stem if stem and number.isdigit() else path.stem


def names_of(paths: Sequence[Path]) -> list[str]:
    """Names of recordings: the stem, with as much of the path as makes names unique.

    ``walking_1`` in two folders are two recordings, and two independent units.
    """
    distinct = {path.absolute() for path in paths}
    found = []
    for path in paths:
        full = path.absolute()
        if sum(other.stem == full.stem for other in distinct) == 1:
            found.append(full.stem)
            continue
        ends = ["/".join(full.parts[-count:]) for count in range(1, len(full.parts) + 1)]
        others = [f"/{other}" for other in distinct - {full}]
        found.append(next(e for e in ends if not any(o.endswith(f"/{e}") for o in others)))
    return found


def check_rate(path: Path, what: str, rate_hz: float) -> None:
    """Reject an implausible recording rate.

    Raises:
        RecordingError: ``what`` in the file gives a rate out of range, or NaN.
    """
    if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise RecordingError(
            f"recording {path}: {what} gives {rate_hz:g} frames per second; it must be "
            f"{MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}; correct it there"
        )


def check_gaps(path: Path, arrivals: Sequence[int]) -> None:
    """Reject scenes that a replay would never reach, or would give in a different order.

    Raises:
        RecordingError: two arrivals (ns) are more than ``MAX_GAP_S`` apart, or go back.
    """
    for k, (before, after) in enumerate(itertools.pairwise(arrivals), start=1):
        if not 0 <= after - before <= MAX_GAP_S * 1e9:
            seconds = (after - before) / 1e9
            raise RecordingError(
                f"recording {path}: scene {k + 1} arrives {seconds:.6g} s after the one before it; "
                f"expected 0 to {MAX_GAP_S:g} s; its times are damaged, record it again"
            )


def recording_of_one(
    path: Path, kind: str, joint_map: JointMap, raw: Floats, *, rate_hz: float, person: int
) -> Recording:
    """A recording of one person from (F, J, 3); see ``recording_of``."""
    return recording_of(path, kind, joint_map, raw[:, None], rate_hz=rate_hz, ids=[person])


def recording_of(
    path: Path,
    kind: str,
    joint_map: JointMap,
    raw: Floats,
    *,
    rate_hz: float,
    ids: Sequence[int],
    stamps_ns: Sequence[int] | None = None,
) -> Recording:
    """A recording from (F, P, J, 3) in the source's units and axes: all people in every frame.

    ``stamps_ns`` are the frames' times from the first one; by default they are even.

    Joints that are NaN, or farther than ``MAX_COORDINATE_M`` from the origin, are not observed. The
    recording's ``note`` counts the frames without any observed joint; for a format that cannot
    leave joints out ("bvh"), the frames in which some joint is not observed.
    """
    believed = np.abs(raw) <= MAX_COORDINATE_M / joint_map.scale_to_m  # false for NaN
    observed = np.asarray(believed.all(axis=-1))
    positions = joint_map.to_metres_z_up(np.where(observed[..., None], raw, np.nan))
    if stamps_ns is None:
        stamps_ns = [round(k * 1e9 / rate_hz) for k in range(len(positions))]
    scenes = [
        Scene(
            stamps_ns[k],
            k,
            True,
            tuple(Person(n, positions[k, p], observed[k, p]) for p, n in enumerate(ids)),
        )
        for k in range(len(positions))
    ]
    whole = kind == "bvh"
    good = observed.all(axis=(1, 2)) if whole else observed.any(axis=(1, 2))
    poor = int(np.count_nonzero(~good))
    what = "some joint is not a valid number" if whole else "no joint is known"
    note = f"in {poor} of {len(scenes)} frames {what}" if poor else ""
    times = [scene.stamp_ns for scene in scenes]
    return Recording(
        path=path,
        kind=kind,
        joint_map=joint_map,
        rate_hz=rate_hz,
        scenes=scenes,
        arrival_ns=times,
        note=note,
    )


def converted_by(path: Path, options: str) -> str:
    """Return the remedy for a file without the information in these options of ``convert``."""
    names = shlex.quote(str(path)), shlex.quote(f"{path.stem}_right.mcap")
    return f"this writes a correct file: hri-predict convert {' '.join(names)} {options}"


def noted(recording: Recording, note: str) -> Recording:
    """The recording with one more note for the user; "" adds nothing."""
    return replace(recording, note="; ".join(n for n in (recording.note, note) if n))


def from_left_handed(recording: Recording, axes: Sequence[str]) -> Recording:
    """The recording as if it had been read with these axes of a left-handed world.

    Args:
        recording: as its format's own axes give it.
        axes: the file's axes that are forward, left and up.

    Raises:
        ConfigError: they are not three different ones, or right-handed.
    """
    return turned(recording, recording.joint_map.with_axes(axes, left_handed=True))


def turned(recording: Recording, joint_map: JointMap) -> Recording:
    """The recording as if it had been read with this map of other axes, and the same units."""
    matrix = np.eye(4)
    matrix[:3, :3] = joint_map.rotation @ recording.joint_map.rotation.T  # via the file's own
    return replace(_moved(recording, matrix), joint_map=joint_map)


def placed(
    recording: Recording, room_from_source: Pose, place: Sequence[float] | None
) -> Recording:
    """Place a recording in the room.

    ``room_from_source`` is the pose of the file's frame in the room; it has no effect on scenes
    that are in the room already. ``place`` (x, y, yaw) then moves everything over the floor
    so that the recording's *start* is at x, y with its heading along yaw. The start is the first
    position of the waist, or else of the middle of what was observed. The heading is the direction
    of travel in the first second if that is 0.3 m or more, or else where the body faces.
    """
    matrix = np.eye(4) if recording.in_room else room_from_source.matrix()
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
    """Return the first person's start: (2,) metres on the floor, and heading (rad)."""
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
                anchor, person_id, start_ns = here, person.id, scene.stamp_ns
                facing = _facing(joints, seen)
            travel = here - anchor
            if np.hypot(*travel) >= HEADING_TRAVEL_M:
                return anchor, math.atan2(travel[1], travel[0])
        if anchor is not None and scene.stamp_ns - start_ns > HEADING_WINDOW_S * 1e9:
            break
    return (np.zeros(2) if anchor is None else anchor), facing


def _middle(joints: Floats, seen: Bools) -> Floats | None:
    """Return the waist on the floor, or the middle of the shoulders or of all joints seen."""
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
    """Return the direction a body faces: perpendicular to the line of hips, or shoulders, ..."""
    for part in ("hip", "shoulder", "elbow", "wrist"):
        left, right = JOINTS.index(f"l_{part}"), JOINTS.index(f"r_{part}")
        if seen[left] and seen[right]:
            across = joints[left] - joints[right]  # to the left; ahead is a quarter turn clockwise
            return math.atan2(-across[0], across[1])
    return 0.0
