"""The topics of a recording, and the JSON schema of each.

A recording is an MCAP file (https://mcap.dev/spec) of JSON messages with JSON schemas, so that
Foxglove and every MCAP library open it. MCAP's *log time* is UTC, its *publish time* the node's
clock, both in nanoseconds; fields whose names end in ``_ns`` are of the node's clock, unless they
say ``utc``. In recordings of format 1 both times are the node's clock.

| topic | when | what |
|---|---|---|
| /scene | each scene received | as received, *exact*: a replay feeds the node the same numbers |
| /received | each message of a controller | RobotState, Acknowledge, with the link's name |
| /status | each tick | the message's fields, all reasons, the named zones |
| /advice/ROBOT | each tick | the message's fields as plain numbers, and what it rests on |
| /node | each second | counters of the node and its links |
| /clock | each second | UTC beside the node's clock; it shows when either was set or stood still |
| /forecast | ``poses_hz`` | predicted joints of every n-th step, rounded to 1 mm |
| /zones | ``zones_hz`` | capsules of every n-th horizon, rounded to 1 mm |
| /view/... | ``view_hz`` | scene, people, frames for a 3D view, in Foxglove's own messages |
| /sent | each unit written to a link | link, CAN id where there is one, bytes in base64 |
"""

from collections.abc import Sequence
from typing import Any

from hri_predict.recording.mcap import well_known

_NUMBER: dict[str, Any] = {"type": "number"}
_WHOLE: dict[str, Any] = {"type": "integer"}
_TEXT: dict[str, Any] = {"type": "string"}
_TRUTH: dict[str, Any] = {"type": "boolean"}
_PERHAPS: dict[str, Any] = {"type": ["number", "null"]}
_PERHAPS_WHOLE: dict[str, Any] = {"type": ["integer", "null"]}
_OBJECT: dict[str, Any] = {"type": "object"}


def _list(items: dict[str, Any], length: int | None = None) -> dict[str, Any]:
    exact = {} if length is None else {"minItems": length, "maxItems": length}
    return {"type": "array", "items": items, **exact}


_PERSON = {
    "type": "object",
    "properties": {
        "id": _WHOLE,
        "observed": {"type": "string", "pattern": "^[01]*$"},
        "positions": _list(_list(_PERHAPS, 3)),
    },
    "required": ["id", "observed", "positions"],
}
_ADVICE: dict[str, dict[str, Any]] = {
    "type": _TEXT,
    "now_ns": _WHOLE,
    "robot": _WHOLE,
    "name": _TEXT,
    "level": _TEXT,
    "level_number": _WHOLE,
    "reason": _TEXT,
    "detail": _TEXT,
    "latch_id": _WHOLE,
    "mode": _TEXT,
    "tool": _PERHAPS_WHOLE,
    "separation_m": _PERHAPS,
    "predicted_separation_m": _PERHAPS,
    "time_to_breach_s": _PERHAPS,
    "speed_limit_m_s": _PERHAPS,
    "speed_m_s": _PERHAPS,
    "needed_m": _PERHAPS,
    "age_s": _PERHAPS,
    "capture_ns": _PERHAPS_WHOLE,
    "body_part": _PERHAPS_WHOLE,
    "robot_link": _PERHAPS_WHOLE,
    "echo": _PERHAPS_WHOLE,
    "grounds": {"type": ["object", "null"]},
}
OWN: dict[str, dict[str, Any]] = {
    "/scene": {
        "capture_ns": _WHOLE,
        "sequence": _WHOLE,
        "receipt_ns": _WHOLE,
        "sees_room": _TRUTH,
        "people": _list(_PERSON),
    },
    "/received": {"link": _TEXT, "received_ns": _WHOLE, "type": _TEXT},
    "/status": {
        "type": _TEXT,
        "now_ns": _WHOLE,
        "node_state": _TEXT,
        "reason": _TEXT,
        "reasons": _list(_TEXT),
        "people": _WHOLE,
        "predictor": _WHOLE,
        "cycle": _WHOLE,
        "age_s": _PERHAPS,
        "capture_ns": _PERHAPS_WHOLE,
        "named_zones": _OBJECT,
    },
    "/node": {"now_ns": _WHOLE, "people": _OBJECT, "node": _OBJECT, "links": _OBJECT},
    "/clock": {
        "now_ns": _WHOLE,
        "utc": _TEXT,
        "utc_ns": _WHOLE,
        "boot_ns": _WHOLE,
        "utc_moved_s": _NUMBER,
        "suspended_s": _NUMBER,
        "dropped": _WHOLE,
    },
    "/forecast": {
        "now_ns": _WHOLE,
        "ids": _list(_WHOLE),
        "capture_ns": _list(_WHOLE),
        "steps": _list(_WHOLE),
        "positions": _list(_list(_list(_list(_PERHAPS, 3)))),
    },
    "/zones": {
        "now_ns": _WHOLE,
        "ids": _list(_WHOLE),
        "segments": _list(_TEXT),
        "times_s": _list(_NUMBER),
        "capsules": _list(_list(_list(_list(_PERHAPS, 7)))),
    },
    "/sent": {"link": _TEXT, "id": _PERHAPS_WHOLE, "data": _TEXT},
}
WELL_KNOWN: dict[str, dict[str, Any]] = {
    "/view/scene": well_known.SCENE_UPDATE,
    "/view/people": well_known.POSES_IN_FRAME,
    "/view/frames": well_known.FRAME_TRANSFORMS,
}


def advice_topic(robot: str) -> str:
    """The topic of a robot's advice; topics have no blanks and slashes within names."""
    return "/advice/" + "".join(c if c.isalnum() or c in "_-" else "_" for c in robot)


def schemas(robots: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Topic -> JSON schema, whose ``title`` is its name."""
    own = {topic: _titled(topic, properties) for topic, properties in OWN.items()}
    advice = {advice_topic(robot): _titled("/advice", _ADVICE) for robot in robots}
    return {**own, **advice, **WELL_KNOWN}


def _titled(topic: str, properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "title": f"hri_predict.{topic.removeprefix('/').capitalize()}",
        "type": "object",
        "properties": properties,
        "required": list(properties),
    }
