"""ROS messages as rosbags' plain values."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.protocol.ros.bodies import MARKER_ARRAY, POSE_ARRAY
from hri_predict.protocol.ros.messages import TF_MESSAGE, Release, typestore
from hri_predict.protocol.ros.tracked import IDS_LIST
from hri_predict.protocol.ros.zed import OBJECTS

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class Maker:
    """Makes messages of one release."""

    def __init__(self, release: Release = "jazzy") -> None:
        self.store = typestore(release)
        self._types = self.store.types

    def cdr(self, message: Any, kind: str) -> bytes:
        return bytes(self.store.serialize_cdr(message, kind))

    def header(self, frame: str, at_ns: int) -> Any:
        sec, nanosec = divmod(at_ns, 10**9)
        stamp = self._make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        more = {"seq": 0} if "seq" in self._names("std_msgs/msg/Header") else {}
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def poses(self, points: Floats, frame: str = "map", at_ns: int = 1) -> Any:
        """``PoseArray`` of (N, 3)."""
        poses = [self._pose(point) for point in np.asarray(points, float).reshape(-1, 3)]
        return self._make(POSE_ARRAY, header=self.header(frame, at_ns), poses=poses)

    def markers(
        self, bodies: dict[int, Floats], frame: str = "map", at_ns: int = 1, kind: int = 2
    ) -> Any:
        """``MarkerArray`` of spheres: (J, 3) by the body's number."""
        shown = [
            self.marker(100 * body + joint, point, frame=frame, at_ns=at_ns, kind=kind)
            for body, points in bodies.items()
            for joint, point in enumerate(points)
        ]
        return self._make(MARKER_ARRAY, markers=shown)

    def marker_array(self, markers: Sequence[Any]) -> Any:
        return self._make(MARKER_ARRAY, markers=list(markers))

    def marker(
        self,
        number: int,
        point: Floats,
        *,
        frame: str = "map",
        at_ns: int = 1,
        kind: int = 2,
        action: int = 0,
    ) -> Any:
        zero = self._make("builtin_interfaces/msg/Duration", sec=0, nanosec=0)
        colour = self._make("std_msgs/msg/ColorRGBA", r=1.0, g=0.0, b=0.0, a=1.0)
        given = {
            "header": self.header(frame, at_ns), "ns": "", "id": number, "type": kind,
            "action": action, "pose": self._pose(point), "scale": self._xyz((0.1, 0.1, 0.1)),
            "color": colour, "lifetime": zero, "frame_locked": False, "points": [], "colors": [],
            "text": "", "mesh_resource": "", "mesh_use_embedded_materials": False,
            "texture_resource": "", "uv_coordinates": [],
        }  # fmt: skip
        name = "visualization_msgs/msg/Marker"
        if "texture" in self._names(name):
            empty = np.zeros(0, np.uint8)
            given["texture"] = self._make(
                "sensor_msgs/msg/CompressedImage",
                header=self.header("", 0), format="", data=empty,
            )  # fmt: skip
            given["mesh_file"] = self._make(
                "visualization_msgs/msg/MeshFile", filename="", data=empty
            )
        return self._make(name, **{key: given[key] for key in self._names(name)})

    def tracked(self, *ids: str, at_ns: int = 1) -> Any:
        """``IdsList`` of the bodies that ROS4HRI tracks."""
        return self._make(IDS_LIST, header=self.header("", at_ns), ids=list(ids))

    def body(self, name: str, joints: dict[str, Sequence[float]], at_ns: int = 1) -> Any:
        """``TFMessage`` of a body's frames: places in ``camera``, by the frame's first word."""
        edges = [
            ("camera", f"{joint}_{name}", tuple(xyz), UPRIGHT) for joint, xyz in joints.items()
        ]
        return self.transforms(*edges, at_ns=at_ns)

    def objects(
        self, bodies: dict[int, Floats], frame: str = "map", at_ns: int = 1, kind: str = OBJECTS,
        **fields: Any,
    ) -> Any:  # fmt: skip
        """``ObjectsStamped``: (J, 3) by the body's number; ``fields`` of each object."""
        formats = {18: 0, 34: 1, 38: 2, 70: 3}
        one = dict(self.store.fielddefs[kind][1])["objects"][1][0][1]
        objects = []
        for number, points in bodies.items():
            each = self._empty(one)
            each.label, each.label_id, each.confidence = f"Body_{number}", number, 90.0
            each.tracking_available = each.skeleton_available = True
            each.tracking_state, each.body_format = 1, formats.get(len(points), 3)
            for keypoint, point in zip(each.skeleton_3d.keypoints, points, strict=False):
                keypoint.kp = np.asarray(point, np.float32)
            for field, value in fields.items():
                setattr(each, field, value)
            objects.append(each)
        return self._make(kind, header=self.header(frame, at_ns), objects=objects)

    def _empty(self, name: str) -> Any:
        """A message of zeros."""
        return self._make(name, **{f: self._zero(d) for f, d in self.store.fielddefs[name][1]})

    def _zero(self, definition: Any) -> Any:
        node, detail = definition
        if node.name == "BASE":
            return "" if detail[0] == "string" else False if detail[0] == "bool" else 0
        if node.name == "NAME":
            return self._empty(detail)
        inner, count = detail
        if inner[0].name == "NAME":
            return [self._empty(inner[1]) for _ in range(count)]
        return np.zeros(count, inner[1][0])

    def transforms(
        self, *edges: tuple[str, str, tuple[float, ...], tuple[float, ...]], at_ns: int = 1
    ) -> Any:
        """``TFMessage`` of (parent, child, xyz, quaternion xyzw)."""
        made = [
            self._make(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(parent, at_ns),
                child_frame_id=child,
                transform=self._make(
                    "geometry_msgs/msg/Transform",
                    translation=self._xyz(xyz),
                    rotation=self._quaternion(turn),
                ),
            )
            for parent, child, xyz, turn in edges
        ]
        return self._make(TF_MESSAGE, transforms=made)

    def _pose(self, point: Sequence[float] | Floats) -> Any:
        x, y, z = map(float, point)
        place = self._make("geometry_msgs/msg/Point", x=x, y=y, z=z)
        turn = self._quaternion(UPRIGHT)
        return self._make("geometry_msgs/msg/Pose", position=place, orientation=turn)

    def _xyz(self, xyz: Sequence[float]) -> Any:
        x, y, z = xyz
        return self._make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def _quaternion(self, turn: Sequence[float]) -> Any:
        x, y, z, w = turn
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _make(self, name: str, **values: Any) -> Any:
        return self._types[name](**values)

    def _names(self, name: str) -> list[str]:
        return [field for field, _ in self.store.fielddefs[name][1]]
