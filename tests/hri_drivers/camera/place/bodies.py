"""People of whom the place is known, and the landmarks that a network would give of them."""

import numpy as np

from hri_drivers.camera.place.camera import Camera, guessed_camera
from hri_drivers.camera.seen import Seen
from hri_predict.base.arrays import Floats
from hri_predict.contracts.joint_map import load_joint_map

JOINTS = load_joint_map("mediapipe33").source_joints
CAMERA = guessed_camera(1280, 720, 64.0)


def person(layout: str = "mediapipe33") -> Floats:
    """Return (J, 3): an adult of 1.70 m with raised forearms, around the middle of his hips.

    Metres in a camera's axes; he faces the camera.
    """
    places = {
        "shoulder": (0.18, -0.49, 0.0),
        "elbow": (0.22, -0.18, 0.05),
        "wrist": (0.20, -0.25, -0.19),
        "hip": (0.09, 0.0, 0.0),
        "knee": (0.10, 0.42, -0.03),
        "ankle": (0.11, 0.83, 0.02),
        "heel": (0.11, 0.87, 0.07),
        "foot_index": (0.12, 0.89, -0.13),
        "pinky": (0.21, -0.27, -0.26),
        "index": (0.19, -0.28, -0.28),
        "thumb": (0.18, -0.27, -0.24),
        "ear": (0.07, -0.67, -0.02),
        "eye": (0.03, -0.70, -0.10),
        "eye_inner": (0.02, -0.70, -0.10),
        "eye_outer": (0.045, -0.70, -0.09),
        "mouth": (0.025, -0.62, -0.10),
    }
    points = {"nose": (0.0, -0.66, -0.12)}
    for name, (x, y, z) in places.items():
        for side, sign in (("left", 1), ("right", -1)):
            both = f"{name}_{side}" if name == "mouth" else f"{side}_{name}"
            points[both] = (sign * x, y, z)
    return np.array([points[joint] for joint in load_joint_map(layout).source_joints])


def toward(ray: Floats) -> Floats:
    """Return (3, 3) the rotation from the axes of a camera that looks along ``ray``, not rolled."""
    z = ray / np.linalg.norm(ray)
    axis = np.cross([0.0, 0.0, 1.0], z)
    skew = np.cross(np.eye(3), axis)
    rotation: Floats = np.eye(3) + skew + skew @ skew / (1 + z[2])
    return rotation


def seen_at(place: Floats, camera: Camera = CAMERA, *, body: Floats | None = None) -> Seen:
    """Return what a network without errors gives of a body whose hips are at ``place`` (3,).

    Its landmarks are turned as by a camera that looks straight at the hips, as BlazePose's are.
    """
    body = person() if body is None else body
    pixels = camera.project(body + place)
    return Seen(1, "mediapipe33", pixels, np.ones(len(body)), body @ toward(place))
