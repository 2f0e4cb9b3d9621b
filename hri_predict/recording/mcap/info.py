"""Metadata of a recording, as needed for a replay."""

import json
import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field

import numpy as np

from hri_predict.base.errors import RecordingError
from hri_predict.base.settings import MAX_RATE_HZ, MIN_RATE_HZ, Pose
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.rigid_joint import RigidJoint
from hri_predict.protocol.definition import SCHEMA_VERSION

FORMAT_VERSION = "2"
"""In format 1, MCAP's log time was on the node's clock; now it is UTC."""
READABLE = ("1", "2")
LIBRARY = "hri-predict"
METADATA = "hri_predict"


@dataclass(frozen=True, slots=True)
class FullSpeed:
    """Distances from people at which a robot may run at full speed, and may start.

    Attributes:
        enough_m: enough by the standard, with the longest delay and all margins, for people at a
            measured speed that it assumes; the zones may permit full speed nearer.
        z_r_m: the uncertainty Z_r of the robot's position in it, at rest. A moving robot's may be
            greater, and adds to both distances.
        start_m: enough for the slowest speed that is advised, with the same assumptions; ``None``
            if the recording does not state it.
    """

    enough_m: float
    z_r_m: float
    start_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class RecordingInfo:
    """Data that a replay needs besides the messages; stored in the file's metadata.

    Attributes:
        joint_map: the source's joint map; complete, so a replay needs no other file.
        rate_hz: nominal scenes per second.
        declares_noise: see ``source.Source``.
        config: the configuration's text.
        cell: the cell's name.
        robots: each robot's name, and the names of its capsules.
        frames: poses in the room that do not change, by name: the robots' bases.
        has_utc: read from a file: its log times are UTC. Recordings of format 1 and those of
            virtual runs have none.
        predictor: name of the predictor; ``forecast_rate_hz`` has its steps per second.
        in_room: whether the scenes are in the room's frame; false in what ``convert`` makes of a
            motion file, which is in that file's own.
        coverage: basis of its zones, in words; "" in recordings of older versions.
        last_latch_id: the number before the first that an Acknowledge may name in it, so that a
            replay gives the same; ``None`` in recordings of older versions.
        full_speed: by name, of each robot that the standard's distance may release; empty in
            recordings of older versions.
    """

    joint_map: JointMap
    rate_hz: float
    declares_noise: bool
    config: str = ""
    cell: str = ""
    robots: tuple[tuple[str, tuple[str, ...]], ...] = ()
    frames: tuple[tuple[str, Pose], ...] = ()
    has_utc: bool = False
    predictor: str = ""
    forecast_rate_hz: float = 0.0
    coverage: str = ""
    in_room: bool = True
    last_latch_id: int | None = None
    full_speed: Mapping[str, FullSpeed] = field(default_factory=dict)

    def to_metadata(self) -> dict[str, str]:
        """As MCAP metadata: strings only."""
        return {
            "format": FORMAT_VERSION,
            "protocol_version": str(SCHEMA_VERSION),
            "joint_map": self.joint_map.name,
            "source_joints": json.dumps(self.joint_map.source_joints),
            "scale_to_m": repr(self.joint_map.scale_to_m),
            "rotation": json.dumps(self.joint_map.rotation.tolist()),
            "weights": json.dumps(self.joint_map.weights.tolist()),
            "rigid": json.dumps({k: v.model_dump() for k, v in self.joint_map.rigid.items()}),
            "rate_hz": repr(self.rate_hz),
            "declares_noise": json.dumps(self.declares_noise),
            "config": self.config,
            "cell": self.cell,
            "robots": json.dumps(self.robots),
            "frames": json.dumps([[name, pose.model_dump()] for name, pose in self.frames]),
            "predictor": self.predictor,
            "forecast_rate_hz": repr(self.forecast_rate_hz),
            "coverage": self.coverage,
            "last_latch_id": json.dumps(self.last_latch_id),
            "full_speed": json.dumps({k: astuple(v) for k, v in self.full_speed.items()}),
        } | ({} if self.in_room else {"in_room": "false"})

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> "RecordingInfo":
        """Back from MCAP metadata.

        Raises:
            RecordingError: another format version, or fields are missing or of the wrong type.
        """
        if metadata.get("format") not in READABLE:
            raise RecordingError(
                f"recorded in format {metadata.get('format')!r}, this version reads "
                f"{' and '.join(map(repr, READABLE))}; replay it with the version that recorded it"
            )
        try:
            rate_hz = float(metadata["rate_hz"])
            if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
                raise ValueError(f"rate_hz {rate_hz:g}, not {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}")
            return cls(
                joint_map=_joint_map(metadata),
                rate_hz=rate_hz,
                declares_noise=json.loads(metadata["declares_noise"]) is True,
                config=metadata.get("config", ""),
                cell=metadata.get("cell", ""),
                robots=_robots(metadata),
                frames=_frames(metadata),
                has_utc=metadata["format"] != "1" and metadata.get("clocks") == "system",
                predictor=metadata.get("predictor", ""),
                forecast_rate_hz=float(metadata.get("forecast_rate_hz", "0")),
                coverage=metadata.get("coverage", ""),
                in_room=metadata.get("in_room") != "false",
                last_latch_id=_number(metadata.get("last_latch_id", "null")),
                full_speed=_full_speed(metadata),
            )
        except (KeyError, ValueError, TypeError, OverflowError, RecursionError) as error:
            raise RecordingError(f"its metadata are damaged ({error}); record it again") from error


def _number(text: str) -> int | None:
    number = json.loads(text)
    return None if number is None else int(number)


def _full_speed(metadata: Mapping[str, str]) -> dict[str, FullSpeed]:
    found = {}
    for name, (enough_m, z_r_m, *rest) in dict(
        json.loads(metadata.get("full_speed", "{}"))
    ).items():
        start_m = rest[0] if rest else None  # missing in recordings made before it was stated
        start_m = None if start_m is None else float(start_m)
        found[str(name)] = FullSpeed(float(enough_m), float(z_r_m), start_m)
    if not all(_is_valid(each) for each in found.values()):
        raise ValueError("full_speed")
    return found


def _is_valid(each: FullSpeed) -> bool:
    start_m = 0.0 if each.start_m is None else each.start_m
    return math.isfinite(each.enough_m) and math.isfinite(start_m) and each.z_r_m >= 0


def _robots(metadata: Mapping[str, str]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    robots = json.loads(metadata.get("robots", "[]"))
    return tuple((str(name), tuple(map(str, capsules))) for name, capsules in robots)


def _frames(metadata: Mapping[str, str]) -> tuple[tuple[str, Pose], ...]:
    frames = json.loads(metadata.get("frames", "[]"))
    return tuple((str(name), Pose.model_validate(pose)) for name, pose in frames)


def _joint_map(metadata: Mapping[str, str]) -> JointMap:
    joints = tuple(str(name) for name in json.loads(metadata["source_joints"]))
    rotation = np.array(json.loads(metadata["rotation"]), dtype=np.float64)
    weights = np.array(json.loads(metadata["weights"]), dtype=np.float64)
    if rotation.shape != (3, 3) or weights.shape != (len(JOINTS), len(joints)):
        raise ValueError("joint map")
    rigid = json.loads(metadata.get("rigid", "{}"))
    if not isinstance(rigid, dict):
        raise ValueError("rigid joints of the joint map")
    rigid = {joint: RigidJoint.model_validate(each) for joint, each in rigid.items()}
    if not all(j in JOINTS and each.sources <= set(joints) for j, each in rigid.items()):
        raise ValueError("rigid joints of the joint map")
    scale_to_m = float(metadata["scale_to_m"])
    sane = np.isfinite(rotation).all() and (weights >= 0).all() and (weights <= 1).all()
    if not (sane and 0 < scale_to_m < math.inf):
        raise ValueError("numbers of the joint map")
    return JointMap(
        name=metadata["joint_map"],
        source_joints=joints,
        scale_to_m=scale_to_m,
        rotation=rotation,
        weights=weights,
        rigid=rigid,
    )
