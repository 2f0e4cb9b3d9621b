"""Sends datagrams like Stereolabs' Live Link senders, as a stand-in in tests and trials.

Written from the published senders for Unreal (2024) and Unity (2022) and the ZED SDK's
``BODY_38_PARTS``; it shares no code with the reader.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_sim.senders.body_points import BodyPoints

MILLIMETRES, METRES = 0, 2
UNITY_AXES, UNREAL_SENDER_AXES = 1, 2
"""LEFT_HANDED_Y_UP and RIGHT_HANDED_Y_UP, as used by the sender for Unreal."""
BODY_38 = 2
ROLE_CAMERA, ROLE_BODY = 1, 2
_SIDED = ("CLAVICLE", "SHOULDER", "ELBOW", "WRIST", "HIP", "KNEE", "ANKLE", "BIG_TOE")


def for_unreal(people: Mapping[int, Floats], stamp_ns: int, frame_id: int) -> list[bytes]:
    """Return the datagrams of one capture, one per body: millimetres, right-handed, y up."""
    head = {
        "frame_id": frame_id,
        "timestamp": stamp_ns,
        "role": ROLE_BODY,
        "body_format": BODY_38,
        "is_new": True,
        "coordinate_system": UNREAL_SENDER_AXES,
        "coordinate_unit": MILLIMETRES,
        "nb_bodies": len(people),
    }
    axes = np.array([[0, -1, 0], [0, 0, 1], [-1, 0, 0]])  # x right, y up, z backward
    bodies = [_body(number, joints @ axes.T * 1000) for number, joints in people.items()]
    return [json.dumps(head | body).encode() for body in bodies]


def for_unity(people: Mapping[int, Floats], stamp_ns: int) -> bytes:
    """Return the datagram of one capture: metres, left-handed, y up."""
    axes = np.array([[0, -1, 0], [0, 0, 1], [1, 0, 0]])  # x right, y up, z forward
    bodies = {
        "body_format": BODY_38,
        "is_new": 1,
        "is_tracked": 1,
        "timestamp": stamp_ns,
        "nb_object": len(people),
        "body_list": [_body(number, joints @ axes.T) for number, joints in people.items()],
    }
    return json.dumps({"bodies": bodies, "fusionMetrics": {"mean_camera_fused": 2.0}}).encode()


def camera(stamp_ns: int, frame_id: int) -> bytes:
    """Return the datagram of a camera's pose, which the sender for Unreal may add."""
    nowhere = {"x": 0.0, "y": 0.0, "z": 0.0}
    return json.dumps(
        {"serial_number": 1, "frame_id": frame_id, "timestamp": stamp_ns, "role": ROLE_CAMERA,
         "coordinate_system": 2, "coordinate_unit": 0, "camera_position": nowhere,
         "camera_orientation": nowhere | {"w": 1.0}}
    ).encode()  # fmt: skip


def _body(number: int, joints: Floats) -> dict[str, Any]:
    keypoints = keypoints_of(joints)
    seen = (keypoints != 0).any(axis=1)
    return {
        "id": number,
        "tracking_state": 1,
        "action_state": 0,
        "confidence": 90.0,
        "position": _place(keypoints[0]),
        "keypoint": [_place(each) for each in keypoints],
        "keypoint_confidence": [90.0 if each else 0.0 for each in seen],
        "local_orientation_per_joint": [{"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}] * 38,
    }


def keypoints_of(joints: Floats) -> Floats:
    """Return (38, 3) in any axes; zeros for joints that the canonical skeleton does not define."""
    body = BodyPoints(np.asarray(joints))
    across = body.at("l_shoulder") - body.at("r_shoulder")
    ear = 0.2 * across
    found = np.zeros((38, 3))
    found[0] = body.at("waist")
    found[1] = body.between("waist", "torso", 0.5)
    found[2] = body.at("torso")
    found[3] = body.between("torso", "neck", 0.5)
    found[4] = body.at("neck")
    found[8], found[9] = body.at("head") + ear, body.at("head") - ear
    for k, side in enumerate("lr"):
        places = dict(zip(_SIDED, body.limbs(side), strict=True))
        for row, part in zip((10, 12, 14, 16, 18, 20, 22, 24), _SIDED, strict=True):
            found[row + k] = places[part]
        found[34 + k] = body.at(f"{side}_hand")
    return found


def _place(place: Floats) -> dict[str, float]:
    return dict(zip("xyz", (round(float(each), 5) for each in place), strict=True))
