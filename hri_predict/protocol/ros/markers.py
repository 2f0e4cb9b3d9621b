"""People, zones and forecast poses as ``visualization_msgs/MarkerArray``, for RViz and Foxglove.

Each message is self-contained: the namespace and id of a marker identify the person, horizon and
part, and a marker that is not updated disappears after ``LIFETIME_NS``. The colours are those of
the levels.
"""

import math
import struct
from collections.abc import Sequence

from hri_predict.base.looks import LOOKS
from hri_predict.base.skeleton import JOINTS, PARENTS
from hri_predict.protocol.messages import Level, Pose, Zone, ZoneCapsule
from hri_predict.protocol.ros.bodies import IDS_PER_BODY
from hri_predict.protocol.ros.cdr import HEAD, Point, Writer

LIFETIME_NS = 500_000_000
"""Maximum age of a Zone when it is sent (``hri_drivers.links.bulk.STALE_NS``)."""
SPHERE, CYLINDER, LINE_LIST, SPHERE_LIST, POINTS = 2, 3, 5, 7, 8
"""Types of ``visualization_msgs/Marker``."""
ADD = 0
ALPHA_NOW, ALPHA_AHEAD = 0.5, 0.2
BONE_M, JOINT_M = 0.03, 0.06
PERSON_COLOUR = (0.1, 0.4, 0.9, 1.0)
PARTS = 512
"""Marker ids per person: up to two for each of 255 capsules. Person numbers are below 65,536."""
UPRIGHT = (0.0, 0.0, 0.0, 1.0)

Quaternion = tuple[float, float, float, float]
Colour = tuple[float, float, float, float]


def people_markers(
    people: Sequence[tuple[int, Sequence[Point]]], *, stamp_ns: int, frame_id: str
) -> bytes:
    """Return people as ``bodies.of_marker_array`` reads them: a sphere for each joint seen.

    Args:
        people: number and joints of each person, metres, at most ``IDS_PER_BODY`` joints. For a
            person without a visible joint, the first joint is kept, with NaN as its position.
        stamp_ns, frame_id: for the headers.
    """
    drawn: list[tuple[int, Point]] = []
    for number, joints in people:
        seen = [(j, place) for j, place in enumerate(joints) if _all_finite(place)]
        first = number * IDS_PER_BODY
        drawn += [(first + j, place) for j, place in seen or [(0, (math.nan,) * 3)]]
    markers = _Markers(len(drawn), stamp_ns, frame_id, "people")
    for id_, place in drawn:
        shape = (*place, *UPRIGHT, JOINT_M, JOINT_M, JOINT_M)
        markers.add(id_, SPHERE, shape=shape, colour=PERSON_COLOUR)
    return markers.take()


def zone_markers(zone: Zone, *, stamp_ns: int, frame_id: str, level: Level) -> bytes:
    """Return the capsules of a zone, each as a cylinder and a sphere at both ends.

    Args:
        zone: metres, room frame. A capsule with a value that is not finite is omitted.
        stamp_ns: UTC, for the headers.
        frame_id: the room's frame in ROS.
        level: determines the colour.
    """
    colour = LOOKS[level.name].rgba(ALPHA_AHEAD if zone.step else ALPHA_NOW)
    drawn = [
        (zone.person * PARTS + 2 * k, capsule)
        for k, capsule in enumerate(zone.capsules[: PARTS // 2])
        if _is_finite(capsule)
    ]
    markers = _Markers(2 * len(drawn), stamp_ns, frame_id, f"zone {zone.step}")
    for id_, (_, a, b, radius) in drawn:
        width, (middle, turn, length) = 2.0 * radius, _between(a, b)
        cylinder, spheres = (*middle, *turn, width, width, length), (*_ORIGIN, width, width, width)
        markers.add(id_, CYLINDER, shape=cylinder, colour=colour)
        markers.add(id_ + 1, SPHERE_LIST, shape=spheres, colour=colour, points=(*a, *b))
    return markers.take()


def pose_markers(pose: Pose, *, stamp_ns: int, frame_id: str, level: Level) -> bytes:
    """Return the bones of a forecast pose as lines; arguments as for ``zone_markers``.

    A pose with a different skeleton than the canonical one is drawn as points.
    """
    places = {j: (x, y, z) for j, x, y, z in pose.joints if _all_finite((x, y, z))}
    lines: list[float] = []
    if len(pose.joints) == len(JOINTS):
        for joint, parent in enumerate(PARENTS):
            if joint in places and parent in places:
                lines += (*places[joint], *places[parent])
    kind, points = (
        (LINE_LIST, lines) if lines else (POINTS, [v for p in places.values() for v in p])
    )
    markers = _Markers(1, stamp_ns, frame_id, f"forecast {pose.step}")
    shape = (*_ORIGIN, BONE_M, BONE_M, 0.0)
    colour = LOOKS[level.name].rgba(1.0)
    markers.add(pose.person * PARTS, kind, shape=shape, colour=colour, points=points)
    return markers.take()


def _empty_end() -> bytes:
    """Return the final fields of a marker, starting with ``colors``: no texture, text or mesh."""
    writer = Writer()
    writer.put(4, "I", 0)
    writer.text("")
    writer.header(0, "")  # the texture's
    writer.text("")
    writer.put(4, "II", 0, 0)
    for _ in ("text", "mesh_resource", "mesh_file.filename"):
        writer.text("")
    writer.put(4, "IB", 0, 0)
    return writer.take()[len(HEAD) :]


_ORIGIN = (0.0, 0.0, 0.0, *UPRIGHT)
_PLACED = struct.Struct("<10d4fiIB3xI")  # pose and scale to the number of points, without gaps
_END = _empty_end()  # begins at a multiple of 8, after the points
_LIFETIME = divmod(LIFETIME_NS, 1_000_000_000)


class _Markers:
    """Writes markers of one namespace, which are identical except for a few numbers."""

    def __init__(self, count: int, stamp_ns: int, frame_id: str, name: str) -> None:
        begin = Writer()
        begin.header(stamp_ns, frame_id)
        begin.text(name)
        begin.put(4, "")
        self._begin = begin.take()[len(HEAD) :]  # a multiple of 4 long
        self._writer = Writer()
        self._writer.put(4, "I", count)

    def add(
        self,
        id_: int,
        kind: int,
        *,
        shape: Sequence[float],
        colour: Colour,
        points: Sequence[float] = (),
    ) -> None:
        """Append a marker; ``shape``: position, quaternion, scale; ``points``: x, y, z of each."""
        writer = self._writer
        writer.put(4, "")
        writer.append(self._begin)
        writer.put(4, "iii", id_, kind, ADD)
        writer.put(8, "")
        writer.append(_PLACED.pack(*shape, *colour, *_LIFETIME, 0, len(points) // 3))
        if points:
            writer.put(8, f"{len(points)}d", *points)
        writer.append(_END)

    def take(self) -> bytes:
        """Return the ``MarkerArray``."""
        return self._writer.take()


def _between(a: Point, b: Point) -> tuple[Point, Quaternion, float]:
    """Return the midpoint, z-axis rotation and distance of two points."""
    dx, dy, dz = (end - start for start, end in zip(a, b, strict=True))
    middle = ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2)
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    if length == 0.0:
        return middle, UPRIGHT, 0.0
    w = 1.0 + dz / length
    if w < 1e-9:  # straight down: half a turn about x
        return middle, (1.0, 0.0, 0.0, 0.0), length
    x, y = -dy / length, dx / length
    norm = math.sqrt(x * x + y * y + w * w)
    return middle, (x / norm, y / norm, 0.0, w / norm), length


def _is_finite(capsule: ZoneCapsule) -> bool:
    return _all_finite((*capsule.a, *capsule.b, capsule.radius)) and capsule.radius >= 0


def _all_finite(values: Sequence[float]) -> bool:
    return all(map(math.isfinite, values))
