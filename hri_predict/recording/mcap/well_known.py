"""Messages that viewers of robots know by name: ``foxglove.SceneUpdate`` and its like, as JSON.

Names and types of the fields are those of Foxglove's schemas (docs.foxglove.dev, "Foxglove
schemas"). All fields of an entity are written, also empty ones.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.settings import Pose

Rgba = tuple[float, float, float, float]

_NUMBER: dict[str, Any] = {"type": "number"}
_TEXT: dict[str, Any] = {"type": "string"}
_TRUTH: dict[str, Any] = {"type": "boolean"}
_COUNT: dict[str, Any] = {"type": "integer", "minimum": 0}


def _object(title: str, **properties: Any) -> dict[str, Any]:
    return {"title": title, "type": "object", "properties": properties}


def _many(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


def _named(**members: int) -> dict[str, Any]:
    return {"oneOf": [{"title": name, "const": value} for name, value in members.items()]}


_NSEC = {"type": "integer", "minimum": 0, "maximum": 999_999_999}
_TIME = _object("time", sec=_COUNT, nsec=_NSEC)
_DURATION = _object("duration", sec={"type": "integer"}, nsec=_NSEC)
_VECTOR = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_POINT = _object("foxglove.Point3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_COLOR = _object("foxglove.Color", r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_POSE = _object("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)
_SOLID = {"pose": _POSE, "size": _VECTOR, "color": _COLOR}
_LINE = _object(
    "foxglove.LinePrimitive",
    type=_named(LINE_STRIP=0, LINE_LOOP=1, LINE_LIST=2),
    pose=_POSE,
    thickness=_NUMBER,
    scale_invariant=_TRUTH,
    points=_many(_POINT),
    color=_COLOR,
    colors=_many(_COLOR),
    indices=_many(_COUNT),
)
_ARROW = _object(
    "foxglove.ArrowPrimitive",
    pose=_POSE,
    shaft_length=_NUMBER,
    shaft_diameter=_NUMBER,
    head_length=_NUMBER,
    head_diameter=_NUMBER,
    color=_COLOR,
)
_TRIANGLES = _object(
    "foxglove.TriangleListPrimitive",
    pose=_POSE,
    points=_many(_POINT),
    color=_COLOR,
    colors=_many(_COLOR),
    indices=_many(_COUNT),
)
_LABEL = _object(
    "foxglove.TextPrimitive",
    pose=_POSE,
    billboard=_TRUTH,
    font_size=_NUMBER,
    scale_invariant=_TRUTH,
    color=_COLOR,
    text=_TEXT,
)
_MODEL = _object(
    "foxglove.ModelPrimitive",
    pose=_POSE,
    scale=_VECTOR,
    color=_COLOR,
    override_color=_TRUTH,
    url=_TEXT,
    media_type=_TEXT,
    data={"type": "string", "contentEncoding": "base64"},
)
_ENTITY = _object(
    "foxglove.SceneEntity",
    timestamp=_TIME,
    frame_id=_TEXT,
    id=_TEXT,
    lifetime=_DURATION,
    frame_locked=_TRUTH,
    metadata=_many(_object("foxglove.KeyValuePair", key=_TEXT, value=_TEXT)),
    arrows=_many(_ARROW),
    cubes=_many(_object("foxglove.CubePrimitive", **_SOLID)),
    spheres=_many(_object("foxglove.SpherePrimitive", **_SOLID)),
    cylinders=_many(
        _object("foxglove.CylinderPrimitive", **_SOLID, bottom_scale=_NUMBER, top_scale=_NUMBER)
    ),
    lines=_many(_LINE),
    triangles=_many(_TRIANGLES),
    texts=_many(_LABEL),
    models=_many(_MODEL),
)
_DELETION = _object(
    "foxglove.SceneEntityDeletion",
    timestamp=_TIME,
    type=_named(MATCHING_ID=0, ALL=1),
    id=_TEXT,
)
_TRANSFORM = _object(
    "foxglove.FrameTransform",
    timestamp=_TIME,
    parent_frame_id=_TEXT,
    child_frame_id=_TEXT,
    translation=_VECTOR,
    rotation=_QUATERNION,
)

SCENE_UPDATE = _object("foxglove.SceneUpdate", deletions=_many(_DELETION), entities=_many(_ENTITY))
FRAME_TRANSFORMS = _object("foxglove.FrameTransforms", transforms=_many(_TRANSFORM))
POSES_IN_FRAME = _object(
    "foxglove.PosesInFrame", timestamp=_TIME, frame_id=_TEXT, poses=_many(_POSE)
)

_UPRIGHT = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_HERE = {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": _UPRIGHT}
_PARTS = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")


def time_of(utc_ns: int) -> dict[str, int]:
    """Return a time, never before 1970."""
    sec, nsec = divmod(max(0, utc_ns), 1_000_000_000)
    return {"sec": sec, "nsec": nsec}


def entity(
    name: str, utc_ns: int, lifetime_s: float, frame: str, **parts: list[Any]
) -> dict[str, Any]:
    """An entity that vanishes by itself after ``lifetime_s``, unless it is sent again."""
    seconds, rest = divmod(round(lifetime_s * 1e9), 1_000_000_000)
    return {
        "timestamp": time_of(utc_ns),
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": seconds, "nsec": rest},
        "frame_locked": True,
        "metadata": [],
        **{part: parts.get(part, []) for part in _PARTS},
    }


def color(rgba: Rgba) -> dict[str, float]:
    """Red, green, blue and opacity, 0 to 1."""
    return dict(zip("rgba", rgba, strict=True))


def lines(ends: Floats, thickness_m: float, rgba: Rgba) -> dict[str, Any]:
    """Thick lines between pairs of points; ``ends`` (N, 2, 3) metres."""
    return {
        "type": 2,
        "pose": _HERE,
        "thickness": thickness_m,
        "scale_invariant": False,
        "points": [_xyz(point) for point in ends.reshape(-1, 3).round(3).tolist()],
        "color": color(rgba),
        "colors": [],
        "indices": [],
    }


def capsules(ends: Floats, radius: Floats, rgba: Rgba) -> dict[str, list[Any]]:
    """Capsules as cylinders with a ball at each end; ``ends`` (N, 2, 3), ``radius`` (N,) metres."""
    cylinders, balls, seen = [], [], set()
    painted = color(rgba)
    rounded = zip(ends.round(3).tolist(), (2 * radius).round(3).tolist(), strict=True)
    for (a, b), wide in rounded:
        for end in (a, b):
            if (*end, wide) not in seen:  # neighbours share their ends
                seen.add((*end, wide))
                pose = {"position": _xyz(end), "orientation": _UPRIGHT}
                balls.append({"pose": pose, "size": _xyz((wide,) * 3), "color": painted})
        length = math.dist(a, b)
        if length > 0.001:
            middle = [round((p + q) / 2, 4) for p, q in zip(a, b, strict=True)]
            cylinders.append(
                {
                    "pose": {"position": _xyz(middle), "orientation": _along(a, b, length)},
                    "size": _xyz((wide, wide, round(length, 3))),
                    "color": painted,
                    "bottom_scale": 1.0,
                    "top_scale": 1.0,
                }
            )
    return {"cylinders": cylinders, "spheres": balls}


def label(at: Sequence[float], text: str, rgba: Rgba) -> dict[str, Any]:
    """A line of text that always faces the viewer."""
    return {
        "pose": {"position": _xyz(at), "orientation": _UPRIGHT},
        "billboard": True,
        "font_size": 0.12,
        "scale_invariant": False,
        "color": color(rgba),
        "text": text,
    }


def transform(child: str, pose: Pose, utc_ns: int, parent: str) -> dict[str, Any]:
    """Return the pose of a frame in its parent."""
    return {
        "timestamp": time_of(utc_ns),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": _xyz(pose.xyz),
        "rotation": dict(zip("xyzw", pose.quaternion_xyzw, strict=True)),
    }


def poses(points: Floats, utc_ns: int, frame: str) -> dict[str, Any]:
    """Upright poses at (N, 3) points, metres."""
    placed = [{"position": _xyz(p), "orientation": _UPRIGHT} for p in points.round(3).tolist()]
    return {"timestamp": time_of(utc_ns), "frame_id": frame, "poses": placed}


def _xyz(values: Sequence[float]) -> dict[str, float]:
    x, y, z = values
    return {"x": x, "y": y, "z": z}


def _along(a: Sequence[float], b: Sequence[float], length: float) -> dict[str, float]:
    """The rotation from z to the direction from ``a`` to ``b``."""
    x, y, z = ((q - p) / length for p, q in zip(a, b, strict=True))
    if z < -0.9999:  # straight down: half a turn about x
        return {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}
    w = math.sqrt((1.0 + z) / 2.0)
    return {"x": round(-y / (2 * w), 4), "y": round(x / (2 * w), 4), "z": 0.0, "w": round(w, 4)}


# -- read back ----------------------------------------------------------------------------------

DAMAGED = (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError)
"""Raised by those below for an entity that this node did not write."""
FARTHEST_M = 1e4
"""Maximum coordinate; larger ones become NaN."""


def lines_of(entity: dict[str, Any]) -> Floats:
    """(N, 2, 3) ends of an entity's first lines; see ``lines``."""
    points = [_coordinates(point) for point in entity["lines"][0]["points"]]
    return _within(points).reshape(-1, 2, 3)


def capsules_of(entity: dict[str, Any]) -> Floats:
    """(N, 7) ax ay az bx by bz r: the balls and cylinders of an entity; see ``capsules``."""
    rows = []
    for ball in entity["spheres"]:
        at = _coordinates(ball["pose"]["position"])
        rows.append([*at, *at, ball["size"]["x"] / 2])
    for cylinder in entity["cylinders"]:
        turn, at = cylinder["pose"]["orientation"], _coordinates(cylinder["pose"]["position"])
        x, y, z, w = (float(turn[key]) for key in "xyzw")
        axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        half = axis * cylinder["size"]["z"] / 2
        rows.append([*(at - half), *(at + half), cylinder["size"]["x"] / 2])
    return _within(rows).reshape(-1, 7)


def _coordinates(point: dict[str, Any]) -> Floats:
    return np.array([float(point[key]) for key in "xyz"])


def _within(values: list[Any]) -> Floats:
    found = np.array(values, dtype=np.float64)
    return np.where(np.abs(found) < FARTHEST_M, found, np.nan)
