"""The topics of a recording, and the JSON schema of each.

A recording is an MCAP file (https://mcap.dev/spec) of JSON messages with JSON schemas, so that
Foxglove and every MCAP library open it. MCAP's *log time* is UTC, its *publish time* the node's
clock, both in nanoseconds; fields whose names end in ``_ns`` are of the node's clock, unless they
say ``utc``. In recordings of format 1 both times are the node's clock.

| topic | when | what |
|---|---|---|
| /scene | each scene received | as received, *exact*: a replay feeds the node the same numbers |
| /received | each message of a controller | RobotState, Acknowledge, SetChoice; its link |
| /status | each tick | the message's fields, all reasons, the named zones |
| /advice/ROBOT | each tick | the message's fields as plain numbers, and what it rests on |
| /node | each second | counters of the node and its links |
| /clock | each second | UTC and the node's clock; it shows when either was set or stood still |
| /forecast | ``poses_hz`` | predicted joints of every n-th step, rounded to 1 mm |
| /zones | ``zones_hz`` | capsules of every n-th horizon, rounded to 1 mm |
| /view/... | ``view_hz`` | scene, people, frames for a 3D view, in Foxglove's own messages |
| /sent | each unit written to a link | link, CAN id where there is one, bytes in base64 |

What is not known is left out of a message, and ``read_messages`` gives ``None`` there: Foxglove
opens no topic whose schema allows ``null``. Nor does it open lists of lists: schemas say by
``patternProperties`` what those hold, which it passes over and a validator does not.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, get_args, get_type_hints

from hri_predict.protocol.messages import Advice, Status
from hri_predict.recording.mcap import well_known

_NUMBER: dict[str, Any] = {"type": "number"}
_WHOLE: dict[str, Any] = {"type": "integer"}
_TEXT: dict[str, Any] = {"type": "string"}
_TRUTH: dict[str, Any] = {"type": "boolean"}
_NUMBER_OR_NOT_SEEN: dict[str, Any] = {"type": ["number", "null"]}


def _list(items: dict[str, Any], length: int | None = None) -> dict[str, Any]:
    exact = {} if length is None else {"minItems": length, "maxItems": length}
    return {"type": "array", "items": items, **exact}


def _object(fields: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """An object with these fields; one whose name ends in ``?`` may be left out."""
    named = {name.removesuffix("?"): field for name, field in fields.items()}
    nested = {name for name, field in named.items() if _is_refused_by_foxglove(field)}
    found: dict[str, Any] = {
        "type": "object",
        "properties": {name: field for name, field in named.items() if name not in nested},
        "required": [name for name in fields if not name.endswith("?")],
    }
    if nested:
        found["patternProperties"] = {f"^{name}$": named[name] for name in sorted(nested)}
    return found


def _is_refused_by_foxglove(field: dict[str, Any]) -> bool:
    """A list of lists, or of what may be ``null``."""
    items = field.get("items", {}).get("type")
    return items == "array" or isinstance(items, list)


_PLAIN: dict[type, dict[str, Any]] = {int: _WHOLE, float: _NUMBER, str: _TEXT, bool: _TRUTH}


def _fields_of(message: type[Advice | Status]) -> dict[str, dict[str, Any]]:
    """The attributes of a message, as ``format.message_to_dict`` writes them."""
    found = {}
    for name, hint in get_type_hints(message).items():
        kind, *nothing = get_args(hint) or (hint,)  # of ``float | None``: both
        field = _TEXT if issubclass(kind, IntEnum) else _PLAIN[kind]
        found[f"{name}?" if nothing else name] = field
    return found


_ANY = _object({})
_PERSON = _object(
    {
        "id": _WHOLE,
        "observed": {"type": "string", "pattern": "^[01]*$"},
        "positions": _list(_list(_NUMBER_OR_NOT_SEEN, 3)),
        "seen_as?": _ANY,
        "error_m?": _NUMBER,
    }
)
_GROUNDS: dict[str, dict[str, Any]] = {
    "unknown?": _list(_TEXT),
    "way?": _TEXT,
    "person?": _WHOLE,
    "segment?": _TEXT,
    "robot_capsule?": _TEXT,
    "pair_m?": _NUMBER,
    "separation_m?": _NUMBER,
    "slack_m?": _NUMBER,
    "milder_way?": _TEXT,
    "milder_slack_m?": _NUMBER,
    "hidden_ends?": _WHOLE,
    "reaction_s?": _NUMBER,
    "stopping_s?": _NUMBER,
    "human_m_s?": _NUMBER,
    "place_error_m?": _NUMBER,
    "terms_m?": _object({f"{term}?": _NUMBER for term in ("s_h", "s_r", "s_s", "c", "z_d", "z_r")}),
    "protective_m?": _NUMBER,
}
_ADVICE: dict[str, dict[str, Any]] = {
    "type": _TEXT,
    "now_ns": _WHOLE,
    "name": _TEXT,
    **_fields_of(Advice),
    "level_number": _WHOLE,
    "speed_m_s?": _NUMBER,
    "needed_m?": _NUMBER,
    "grounds?": _object(_GROUNDS),
}
OWN: dict[str, dict[str, Any]] = {
    "/scene": {
        "capture_ns": _WHOLE,
        "sequence": _WHOLE,
        "receipt_ns": _WHOLE,
        "sees_room": _TRUTH,
        "people": _list(_PERSON),
        "doubts?": _list(_object({"reason": _TEXT, "text": _TEXT})),
        "joined?": _list(_list(_WHOLE, 2)),
    },
    "/received": {"link": _TEXT, "received_ns": _WHOLE, "type": _TEXT},
    "/status": {
        "type": _TEXT,
        "now_ns": _WHOLE,
        **_fields_of(Status),
        "reasons": _list(_TEXT),
        "named_zones": _ANY,
    },
    "/node": {"now_ns": _WHOLE, "people": _ANY, "node": _ANY, "links": _ANY},
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
        "positions": _list(_list(_list(_list(_NUMBER_OR_NOT_SEEN, 3)))),
    },
    "/zones": {
        "now_ns": _WHOLE,
        "ids": _list(_WHOLE),
        "segments": _list(_TEXT),
        "times_s": _list(_NUMBER),
        "capsules": _list(_list(_list(_list(_NUMBER_OR_NOT_SEEN, 7)))),
    },
    "/sent": {"link": _TEXT, "id?": _WHOLE, "data": _TEXT},
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


def with_unknown(topic: str, data: dict[str, Any]) -> dict[str, Any]:
    """Return a message as before ``to_json``, with ``None`` for fields that were left out."""
    if topic.startswith("/advice"):
        filled = {**_UNKNOWN_ADVICE, **data}
        grounds = filled["grounds"]
        if isinstance(grounds, dict) and "unknown" not in grounds:
            filled["grounds"] = {**_UNKNOWN_GROUNDS, **grounds}
        return filled
    return {**_UNKNOWN.get(topic, {}), **data}


def _unknown(fields: dict[str, dict[str, Any]]) -> dict[str, None]:
    return {name[:-1]: None for name in fields if name.endswith("?")}


_UNKNOWN = {topic: _unknown(fields) for topic, fields in OWN.items()}
_UNKNOWN_ADVICE = _unknown(_ADVICE)
_UNKNOWN_GROUNDS = _unknown({k: v for k, v in _GROUNDS.items() if k != "unknown?"})


def _titled(topic: str, fields: dict[str, dict[str, Any]]) -> dict[str, Any]:
    title = f"hri_predict.{topic.removeprefix('/').capitalize()}"
    return {"title": title, **_object(fields)}
