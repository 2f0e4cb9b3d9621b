"""The contents of a recording: topics, their JSON, and the metadata that a replay needs.

A recording is an MCAP file (https://mcap.dev/spec) of JSON messages with JSON schemas, so that
Foxglove and every MCAP library open it. Times are nanoseconds of the node's clock.

| topic | when | what |
|---|---|---|
| /scene | each scene received | as received, *exact*: a replay feeds the node the same numbers |
| /received | each message of a controller | RobotState, Acknowledge, with the link's name |
| /status, /advice | each tick | the messages' fields; one /advice per robot |
| /forecast | each tick | predicted joints of every n-th step, rounded to 1 mm |
| /zones | every n-th tick | capsules of every n-th horizon, rounded to 1 mm |
| /sent | each unit written to a link | link, CAN id where there is one, bytes in base64 |
"""

import base64
import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from hri_predict.arrays import Floats
from hri_predict.errors import RecordingError
from hri_predict.joint_map import JointMap
from hri_predict.protocol.definition import SCHEMA_VERSION
from hri_predict.protocol.messages import (
    Acknowledge,
    BaseMotion,
    Message,
    OperatingMode,
    RobotMode,
    RobotState,
)
from hri_predict.recording.labels import MAX_ID
from hri_predict.scene import Person, Scene
from hri_predict.settings import MAX_RATE_HZ, MIN_RATE_HZ
from hri_predict.skeleton import JOINTS

FORMAT_VERSION = "1"
LIBRARY = "hri-predict"
METADATA = "hri_predict"
MAX_COUNT = 2**64  # limit of every clock's nanoseconds and every sequence

_NUMBER, _TEXT, _LIST = {"type": "number"}, {"type": "string"}, {"type": "array"}
SCHEMAS: dict[str, dict[str, Any]] = {
    "/scene": {
        "capture_ns": _NUMBER,
        "sequence": _NUMBER,
        "receipt_ns": _NUMBER,
        "sees_room": {"type": "boolean"},
        "people": _LIST,
    },
    "/received": {"link": _TEXT, "received_ns": _NUMBER, "type": _TEXT},
    "/status": {"type": _TEXT, "node_state": _TEXT, "reason": _TEXT, "people": _NUMBER},
    "/advice": {"type": _TEXT, "robot": _NUMBER, "level": _TEXT, "reason": _TEXT},
    "/forecast": {"ids": _LIST, "capture_ns": _LIST, "steps": _LIST, "positions": _LIST},
    "/zones": {"ids": _LIST, "segments": _LIST, "times_s": _LIST, "capsules": _LIST},
    "/sent": {"link": _TEXT, "id": {"type": ["number", "null"]}, "data": _TEXT},
}


@dataclass(frozen=True, kw_only=True)
class RecordingInfo:
    """What a replay needs besides the messages; stored in the file's metadata.

    Attributes:
        joint_map: the source's joint map; complete, so a replay needs no other file.
        rate_hz: nominal scenes per second.
        declares_noise: see ``source.Source``.
        config: the configuration's text.
        predictor: name of the predictor; ``forecast_rate_hz`` has its steps per second.
    """

    joint_map: JointMap
    rate_hz: float
    declares_noise: bool
    config: str = ""
    predictor: str = ""
    forecast_rate_hz: float = 0.0

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
            "rate_hz": repr(self.rate_hz),
            "declares_noise": json.dumps(self.declares_noise),
            "config": self.config,
            "predictor": self.predictor,
            "forecast_rate_hz": repr(self.forecast_rate_hz),
        }

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> "RecordingInfo":
        """Back from MCAP metadata.

        Raises:
            RecordingError: another format version, or fields are missing or of the wrong type.
        """
        if metadata.get("format") != FORMAT_VERSION:
            raise RecordingError(
                f"recorded in format {metadata.get('format')!r}, this version reads "
                f"'{FORMAT_VERSION}'; replay it with the version that recorded it"
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
                predictor=metadata.get("predictor", ""),
                forecast_rate_hz=float(metadata.get("forecast_rate_hz", "0")),
            )
        except (KeyError, ValueError, TypeError, OverflowError, RecursionError) as error:
            raise RecordingError(f"its metadata are damaged ({error}); record it again") from error


def _joint_map(metadata: Mapping[str, str]) -> JointMap:
    joints = tuple(str(name) for name in json.loads(metadata["source_joints"]))
    rotation = np.array(json.loads(metadata["rotation"]), dtype=np.float64)
    weights = np.array(json.loads(metadata["weights"]), dtype=np.float64)
    if rotation.shape != (3, 3) or weights.shape != (len(JOINTS), len(joints)):
        raise ValueError("joint map")
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
    )


def to_json(data: Any) -> bytes:
    """Compact JSON; a number that is not finite becomes ``null``: JSON cannot express it."""
    try:
        text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    except ValueError:
        text = json.dumps(_finite(data), separators=(",", ":"), allow_nan=False)
    return text.encode()


def _finite(data: Any) -> Any:
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    return data


def scene_to_dict(scene: Scene, receipt_ns: int) -> dict[str, Any]:
    """A scene as received. Numbers are exact; ``observed`` is a string of 0 and 1 per joint."""
    return {
        "capture_ns": int(scene.stamp_ns),
        "sequence": int(scene.sequence),
        "receipt_ns": int(receipt_ns),
        "sees_room": bool(scene.sees_room),
        "people": [
            {
                "id": int(person.id),
                "observed": "".join("1" if seen else "0" for seen in person.observed.tolist()),
                "positions": person.positions.tolist(),
            }
            for person in scene.people
        ],
    }


def scene_from_dict(data: dict[str, Any], joints: int) -> tuple[Scene, int]:
    """Back from ``scene_to_dict``: the scene and its receipt (ns, clock of the recording node).

    Raises:
        ValueError, KeyError, TypeError, OverflowError: ``data`` is no such scene.
    """
    people = []
    for person in data["people"]:
        positions = np.array(
            [[math.nan if v is None else v for v in joint] for joint in person["positions"]],
            dtype=np.float64,
        )
        observed = np.array([c == "1" for c in person["observed"]], dtype=np.bool_)
        if positions.shape != (joints, 3) or observed.shape != (joints,):
            raise ValueError(f"a person has {len(observed)} joints, expected {joints}")
        people.append(Person(whole(person["id"], 0, MAX_ID), positions, observed))
    stamp_ns, sequence = whole(data["capture_ns"]), whole(data["sequence"])
    scene = Scene(stamp_ns, sequence, data["sees_room"] is True, tuple(people))
    return scene, whole(data["receipt_ns"])


def whole(value: Any, least: int = -MAX_COUNT, most: int = MAX_COUNT) -> int:
    """A whole number of nanoseconds, a sequence, or an id.

    Raises:
        ValueError, TypeError, OverflowError: it is not one, or is out of range.
    """
    number = int(value)
    if not least <= number <= most:
        raise ValueError(f"a number is not {least} to {most}")
    return number


def message_to_dict(message: Message) -> dict[str, Any]:
    """A message's fields; ``type`` holds its class, and enumerations are given by name."""
    fields = dataclasses.asdict(message)
    named = {k: v.name if isinstance(v, IntEnum) else v for k, v in fields.items()}
    return {"type": type(message).__name__, **named}


def received_from_dict(data: dict[str, Any]) -> RobotState | Acknowledge | None:
    """Back from ``message_to_dict``; ``None`` for a class that a controller does not send.

    Raises:
        ValueError, KeyError, TypeError: ``data`` is not such a message.
    """
    if data["type"] == "RobotState":
        return RobotState(
            robot=int(data["robot"]),
            mode=RobotMode[data["mode"]],
            counter=int(data["counter"]),
            positions=_floats(data["positions"]),
            velocities=_floats(data["velocities"]),
            **_since_version_2(data),
        )
    if data["type"] == "Acknowledge":
        return Acknowledge(latch_id=int(data["latch_id"]), ack_id=int(data["ack_id"]))
    return None


def _since_version_2(data: dict[str, Any]) -> dict[str, Any]:
    """Fields of a RobotState that recordings of protocol version 1 lack."""
    tool, base = data.get("tool"), data.get("base")
    return {
        "request": OperatingMode.__members__.get(data.get("request", ""), OperatingMode.AUTOMATIC),
        "enabling": data.get("enabling") is True,
        "tool": None if tool is None else int(tool),
        "tool_confirmed": data.get("tool_confirmed") is True,
        "base": None if base is None else BaseMotion(**_numbers(base)),
    }


def _numbers(data: dict[str, Any]) -> dict[str, float]:
    return dict(zip(data, _floats(data.values()), strict=True))


def _floats(values: Any) -> tuple[float, ...]:
    return tuple(math.nan if v is None else float(v) for v in values)


def sent_to_dict(link: str, arbitration_id: int | None, data: bytes) -> dict[str, Any]:
    """A unit that was sent."""
    return {"link": link, "id": arbitration_id, "data": base64.b64encode(data).decode("ascii")}


def forecast_to_dict(
    ids: tuple[int, ...], capture_ns: list[int], steps: list[int], positions: Floats
) -> dict[str, Any]:
    """A decimated forecast: ``positions`` (P, len(steps), J, 3) metres, rounded to 1 mm."""
    return {
        "ids": list(ids),
        "capture_ns": capture_ns,
        "steps": steps,
        "positions": np.round(positions, 3).tolist(),
    }


def zones_to_dict(
    ids: tuple[int, ...], segments: tuple[str, ...], times_s: Floats, capsules: Floats
) -> dict[str, Any]:
    """Decimated zones: ``capsules`` (P, K, S, 7) = ax ay az bx by bz r, metres, to 1 mm."""
    return {
        "ids": list(ids),
        "segments": list(segments),
        "times_s": np.round(times_s, 4).tolist(),
        "capsules": np.round(capsules, 3).tolist(),
    }
