"""Bodies from the ZED ROS 2 wrapper: ``zed_msgs/ObjectsStamped`` on ``body_trk/skeletons``.

Keypoints are in metres in the camera's frame, x forward, y left, z up, as the wrapper configures
the SDK; keypoints that were not seen are NaN or zero. A body that the camera does not see but whose
motion the SDK estimates is included without any visible joint.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.protocol.ros.bodies import (
    Bodies,
    Body,
    MessageError,
    check_people,
    known,
    stamp,
)
from hri_predict.protocol.ros.frame_tree import plain_frame

OBJECTS = "zed_msgs/msg/ObjectsStamped"
OBJECTS_BEFORE = "zed_msgs/msg/ObjectsStampedBefore"
"""The message of older wrappers, without a confidence per keypoint, under a type name of ours."""
_OBJECT = """
string label
int16 label_id
string sublabel
float32 confidence
float32[3] position
float32[6] position_covariance
float32[3] velocity
bool tracking_available
int8 tracking_state
int8 action_state
zed_msgs/BoundingBox2Di bounding_box_2d
zed_msgs/BoundingBox3D bounding_box_3d
float32[3] dimensions_3d
bool skeleton_available
int8 body_format
zed_msgs/BoundingBox2Df head_bounding_box_2d
zed_msgs/BoundingBox3D head_bounding_box_3d
float32[3] head_position
zed_msgs/Skeleton2D skeleton_2d
zed_msgs/Skeleton3D skeleton_3d
"""
TEXTS = {
    OBJECTS: "std_msgs/Header header\nzed_msgs/Object[] objects",
    OBJECTS_BEFORE: "std_msgs/Header header\nzed_msgs/ObjectBefore[] objects",
    "zed_msgs/msg/Object": f"{_OBJECT}float32[70] skeleton_keypoint_confidence",
    "zed_msgs/msg/ObjectBefore": _OBJECT,
    "zed_msgs/msg/BoundingBox2Di": "zed_msgs/Keypoint2Di[4] corners",
    "zed_msgs/msg/BoundingBox2Df": "zed_msgs/Keypoint2Df[4] corners",
    "zed_msgs/msg/BoundingBox3D": "zed_msgs/Keypoint3D[8] corners",
    "zed_msgs/msg/Keypoint2Di": "uint32[2] kp",
    "zed_msgs/msg/Keypoint2Df": "float32[2] kp",
    "zed_msgs/msg/Keypoint3D": "float32[3] kp",
    "zed_msgs/msg/Skeleton2D": "zed_msgs/Keypoint2Df[70] keypoints",
    "zed_msgs/msg/Skeleton3D": "zed_msgs/Keypoint3D[70] keypoints",
}
"""Definitions (github.com/stereolabs/zed-ros2-interfaces)."""
KEYPOINTS = {0: 18, 1: 34, 2: 38, 3: 70}
"""Number of keypoints by ``body_format``."""
_OK = 1  # tracking_state


def of_objects(message: Any, names: Sequence[str]) -> Bodies:
    """Return the bodies in an ``ObjectsStamped`` of people with these joints.

    Raises:
        MessageError: objects without a skeleton or tracking, a different body format, a repeated
            id, or too many people.
    """
    check_people(len(message.objects))
    people = [_body(each, len(names)) for each in message.objects]
    if len({body.id for body in people}) < len(people):
        raise MessageError("an id is repeated; set body_tracking.enable_tracking in the wrapper")
    return Bodies(
        stamp_ns=stamp(message.header),
        frame=plain_frame(message.header.frame_id),
        people=tuple(people),
    )


def keypoints_of(message: Any) -> int:
    """Return the number of keypoints of the first skeleton; 0 if there is none."""
    formats = (each.body_format for each in message.objects if each.skeleton_available)
    return KEYPOINTS.get(next(formats, -1), 0)


def _body(one: Any, joints: int) -> Body:
    if not one.skeleton_available:
        raise MessageError("an object has no skeleton; subscribe to body_trk/skeletons")
    if not one.tracking_available:
        raise MessageError(
            "ids are not persistent; set body_tracking.enable_tracking in the wrapper"
        )
    sent = KEYPOINTS.get(one.body_format, 0)
    if sent != joints:
        raise MessageError(
            f"body_format {one.body_format} has {sent or 'an unknown number of'} keypoints, and "
            f"the joint map {joints} joints; correct 'joint_map'"
        )
    points: Floats = np.full((joints, 3), np.nan)
    if one.tracking_state == _OK:
        points = np.array([each.kp for each in one.skeleton_3d.keypoints[:joints]], np.float64)
        points[(points == 0).all(axis=1)] = np.nan
    return Body(int(one.label_id) & 0xFFFF, known(points))
