"""Messages of a recording as JSON and back."""

import base64
import dataclasses
import json
import math
from enum import IntEnum
from typing import Any, TypeVar, get_type_hints

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.contracts.scene import Doubt, Person, Scene, sound_error_m
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    BaseMotion,
    Message,
    OperatingMode,
    RobotMode,
    RobotState,
    SetChoice,
    Status,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.recording.labels import MAX_ID

Sent = TypeVar("Sent", Advice, Status)
MAX_COUNT = 2**64  # limit of every clock's nanoseconds and every sequence


_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode


def to_json(data: dict[str, Any]) -> bytes:
    """Return compact JSON without unknown values.

    A number that is not finite counts as unknown, because JSON cannot express it. Within a list it
    is ``null``.
    """
    try:
        text = _encode(_known(data))
    except ValueError:
        text = _encode(_known(_finite(data)))
    return text.encode()


def _known(data: dict[str, Any]) -> dict[str, Any]:
    """A message, and what stands right in it, without keys whose value is ``None``."""
    found = {}
    for key, value in data.items():
        if type(value) is dict:
            found[key] = {k: v for k, v in value.items() if v is not None}
        elif value is not None:
            found[key] = value
    return found


def _finite(data: Any) -> Any:
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    return data


def scene_to_dict(scene: Scene, receipt_ns: int) -> dict[str, Any]:
    """A scene as received. Numbers are exact; ``observed`` is a string of 0 and 1 per joint.

    Fields of merged sources are left out of other scenes, and so are position errors of 0.
    """
    merged: dict[str, Any] = {}
    if scene.doubts:
        merged["doubts"] = [{"reason": d.reason.name, "text": d.text} for d in scene.doubts]
    if scene.joined:
        merged["joined"] = [list(pair) for pair in scene.joined]
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
                **({"seen_as": dict(person.seen_as)} if person.seen_as else {}),
                **_error_m(person),
            }
            for person in scene.people
        ],
        **merged,
    }


def _error_m(person: Person) -> dict[str, float]:
    """Return a person's position error; -1 if absurd, so that a replay rejects it again."""
    error_m = sound_error_m(person.error_m)
    return {} if error_m == 0 else {"error_m": -1.0 if math.isnan(error_m) else error_m}


def scene_from_dict(data: dict[str, Any], joints: int) -> tuple[Scene, int]:
    """Invert ``scene_to_dict``: return the scene and its receipt (ns, clock of the recording node).

    Raises:
        ValueError, KeyError, TypeError, OverflowError: ``data`` is not such a scene.
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
        seen_as = tuple(
            (str(name), whole(number, 0, MAX_ID))
            for name, number in dict(person.get("seen_as", {})).items()
        )
        error_m = sound_error_m(person.get("error_m", 0.0))
        people.append(Person(whole(person["id"], 0, MAX_ID), positions, observed, seen_as, error_m))
    scene = Scene(
        whole(data["capture_ns"]),
        whole(data["sequence"]),
        data["sees_room"] is True,
        tuple(people),
        doubts=tuple(
            Doubt(Reason[str(doubt["reason"])], str(doubt["text"]))
            for doubt in data.get("doubts", ())
        ),
        joined=tuple(
            (whole(gone, 0, MAX_ID), whole(kept, 0, MAX_ID))
            for gone, kept in data.get("joined", ())
        ),
    )
    return scene, whole(data["receipt_ns"])


def whole(value: Any, least: int = -MAX_COUNT, most: int = MAX_COUNT) -> int:
    """Return a whole number of nanoseconds, a sequence number, or an id.

    Raises:
        ValueError, TypeError, OverflowError: it is not one, or is out of range.
    """
    number = int(value)
    if not least <= number <= most:
        raise ValueError(f"a number is not {least} to {most}")
    return number


def message_to_dict(message: Message) -> dict[str, Any]:
    """A message's fields; ``type`` holds its class, and enumerations are given by name."""
    fields: dict[str, Any] = {"type": type(message).__name__}
    for field in dataclasses.fields(message):  # asdict would copy all, at ten times the cost
        value = getattr(message, field.name)
        if isinstance(value, IntEnum):
            value = value.name
        elif isinstance(value, BaseMotion):
            value = dataclasses.asdict(value)
        fields[field.name] = value
    return fields


def sent_from_dict(kind: type[Sent], data: dict[str, Any]) -> Sent:
    """Back from ``message_to_dict``; other keys are ignored, what is ``None`` has its default.

    Raises:
        ValueError, KeyError, TypeError: ``data`` is not such a message.
    """
    hints, values = get_type_hints(kind), {}
    for field in dataclasses.fields(kind):
        value, hint = data.get(field.name), hints[field.name]
        if value is not None:
            named = isinstance(hint, type) and issubclass(hint, IntEnum)
            values[field.name] = hint[value] if named else value
    return kind(**values)


def received_from_dict(data: dict[str, Any]) -> RobotState | Acknowledge | SetChoice | None:
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
    if data["type"] == "SetChoice":
        return SetChoice(whole(data["number"], 0, 65_535))
    return None


def _since_version_2(data: dict[str, Any]) -> dict[str, Any]:
    """Fields of a RobotState missing in recordings of protocol version 1."""
    tool, base = data.get("tool"), data.get("base")
    return {
        "request": OperatingMode.__members__.get(data.get("request", ""), OperatingMode.AUTOMATIC),
        "enabling": data.get("enabling") is True,
        "tool": None if tool is None else int(tool),
        "tool_confirmed": data.get("tool_confirmed") is True,
        "base": None if base is None else BaseMotion(**_numbers(base)),
    }


def _numbers(data: Any) -> dict[str, float]:
    if not isinstance(data, dict):
        raise TypeError("a base's motion is not a mapping")
    return dict(zip(data, _floats(data.values()), strict=True))


def _floats(values: Any) -> tuple[float, ...]:
    return tuple(math.nan if v is None else float(v) for v in values)


def sent_to_json(link: str, arbitration_id: int | None, data: bytes) -> bytes:
    """A unit that was sent, as ``to_json`` would write it: most messages of a recording are so."""
    identified = "" if arbitration_id is None else f'"id":{arbitration_id},'
    encoded = base64.b64encode(data).decode("ascii")
    return f'{{"link":{_encode(link)},{identified}"data":"{encoded}"}}'.encode()


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
