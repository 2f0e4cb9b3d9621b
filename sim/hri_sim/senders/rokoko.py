"""Sends JSON v3 like Rokoko Studio, as a stand-in in tests, fault tables and trials.

Written from Rokoko's "Custom Streaming" and its sample; it shares no code with the reader.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_sim.senders.body_points import BodyPoints

_PARTS = ("Shoulder", "UpperArm", "LowerArm", "Hand", "UpLeg", "Leg", "Foot", "Toe")


def capture(actors: Mapping[str, Floats], time_s: float, *, lz4: bool = False) -> bytes:
    """Return the datagram of one capture.

    Args:
        actors: by name, (21, 3) canonical joints in metres: x forward, y left, z up.
        time_s: Studio's time.
        lz4: whether to compress it, as Studio does for its own plug-ins.
    """
    scene = {
        "timestamp": time_s,
        "actors": [actor(name, joints) for name, joints in actors.items()],
        "characters": [],
        "props": [],
    }
    text = json.dumps({"version": 3, "fps": 60, "scene": scene}).encode()
    if not lz4:
        return text
    from lz4.frame import compress

    compressed: bytes = compress(text)
    return compressed


def actor(name: str, joints: Floats) -> dict[str, Any]:
    """Return one actor, in Unity's frame."""
    body = BodyPoints(np.asarray(joints)[:, [1, 2, 0]] * [-1.0, 1.0, 1.0])
    parts = {
        "hip": body.at("waist"),
        "spine": body.between("waist", "torso", 0.5),
        "chest": body.at("torso"),
        "neck": body.at("neck"),
        "head": body.at("head"),
    }
    for side, letter in (("left", "l"), ("right", "r")):
        points = zip(_PARTS, body.limbs(letter), strict=True)
        parts |= {f"{side}{part}": point for part, point in points}
        ankle, foot = f"{letter}_ankle", f"{letter}_foot"
        parts[f"{side}ToeEnd"] = parts[f"{side}Toe"]
        parts[f"{side}Toe"] = body.between(ankle, foot, 0.75)
    has = {"hasGloves": False, "hasLeftGlove": False, "hasRightGlove": False, "hasFace": False}
    return {
        "name": name,
        "color": [255, 128, 0],
        "meta": has | {"hasBody": True},
        "dimensions": {"totalHeight": 1.75, "hipHeight": 0.95},
        "body": {part: _joint(place) for part, place in parts.items()},
    }


def _joint(place: Floats) -> dict[str, Any]:
    x, y, z = (round(float(each), 5) for each in place)
    return {
        "position": {"x": x, "y": y, "z": z},
        "rotation": {"x": 0.0, "y": 0.7071, "z": 0.0, "w": 0.7071},
    }
