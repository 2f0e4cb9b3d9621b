"""Frames of ``/tf`` and ``/tf_static``: the pose of one frame in another at a given time.

As in tf2 (REP-105), each frame has one parent. A moving transform is interpolated between two
messages and never extrapolated; it stays valid after its newest message only while it does not
change. Unlike in tf2, two publishers that disagree about a frame are both rejected.
"""

import math
from bisect import bisect_right
from collections import deque
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import rotation_of
from hri_predict.protocol.ros.stamps import stamp_ns

MAX_FRAMES = 1000
MAX_DEPTH = 100
HISTORY = 200
"""Number of transforms kept per frame: 2 s at 100 Hz."""
GAP_NS = 500_000_000
"""Maximum time between two transforms, and after the newest one if the frame does not move."""
STILL_M, STILL = 0.001, 0.0005
"""Maximum change of a transform that counts as still: metres, and quaternion units (1 mrad)."""
NORM_TOLERANCE = 0.01
RIVALS_NS = 1_000_000_000
"""Time for which a moving frame is unknown after a second publisher gave it a different value."""
NO_PUBLISHER = bytes(16)


class UnknownFrame(ValueError):
    """There is no transform between two frames at that time; one line with the cause.

    Attributes:
        later: whether a message that has not arrived yet may provide it.
    """

    def __init__(self, why: str, *, later: bool = False) -> None:
        super().__init__(why)
        self.later = later


class _Edge:
    """The transforms from one frame to its parent."""

    def __init__(self, parent: str, static: bool, publisher: bytes) -> None:
        self.parent = parent
        self.static = static
        self.times: deque[int] = deque(maxlen=HISTORY)
        self.poses: deque[Floats] = deque(maxlen=HISTORY)  # (7,) xyz, quaternion xyzw
        self.publisher = publisher
        self._rivals_ns: int | None = None  # of the newest message after a change of publisher

    def add(self, at_ns: int, pose: Floats, publisher: bytes) -> None:
        if NO_PUBLISHER not in (publisher, self.publisher) and publisher != self.publisher:
            if not (self.static and self.poses and _alike(pose, self.poses[-1])):
                self._rivals_ns = at_ns
            self.times.clear()
            self.poses.clear()
        self.publisher = publisher
        if self.static or (
            self.times and at_ns < self.times[-1] - GAP_NS
        ):  # a clock that restarted
            self.times.clear()
            self.poses.clear()
        if not self.times or at_ns > self.times[-1]:
            self.times.append(at_ns)
            self.poses.append(pose)

    def at(self, child: str, at_ns: int, holds: bool) -> Floats:
        """Return the (4, 4) transform at a time.

        Args:
            child: the frame's name.
            at_ns: a stamp, ns.
            holds: whether a frame at rest remains valid after its newest message.

        Raises:
            UnknownFrame: no transform is valid at that time.
        """
        self._check_publishers(child, at_ns)
        if self.static:
            return _matrix(self.poses[-1])
        k = bisect_right(self.times, at_ns)
        if k and self.times[k - 1] == at_ns:
            return _matrix(self.poses[k - 1])
        if 0 < k < len(self.times):
            before, after = self.times[k - 1], self.times[k]
            if after - before <= GAP_NS:
                share = (at_ns - before) / (after - before)
                return _matrix(_between(self.poses[k - 1], self.poses[k], share))
        later = k == len(self.times) and at_ns - self.times[-1] <= GAP_NS
        if later and holds and self._still():
            return _matrix(self.poses[-1])
        raise UnknownFrame(
            f"the transform of '{child}' in '{self.parent}' has no value at the message's stamp; "
            "publish it at least 10 times a second with the same clock, or on /tf_static",
            later=later,
        )

    def _check_publishers(self, child: str, at_ns: int) -> None:
        """Refuse a frame from two publishers; a static frame until the node is restarted."""
        if self._rivals_ns is None:
            return
        if not self.static and at_ns >= self._rivals_ns + RIVALS_NS:
            self._rivals_ns = None
            return
        remedy = "stop one of them and restart the node" if self.static else "stop one of them"
        raise UnknownFrame(f"two publishers give the transform of '{child}'; {remedy}")

    def _still(self) -> bool:
        return len(self.poses) > 1 and _alike(self.poses[-1], self.poses[-2])


class FrameTree:
    """Collects a bounded number of frames, each for a limited time.

    When it is full, the moving frame that was not updated for the longest time is dropped, with the
    static frames below it.

    Attributes:
        refused: number of transforms that were invalid or exceeded the number of frames.
    """

    def __init__(self) -> None:
        self.refused = 0
        self._edges: dict[str, _Edge] = {}  # those that move in the order of their newest message

    def add(self, message: Any, *, static: bool, publisher: bytes = NO_PUBLISHER) -> None:
        """Process a ``tf2_msgs/TFMessage``; invalid transforms in it are counted.

        Args:
            message: an object with the attributes of that type.
            static: whether it came on ``/tf_static``.
            publisher: 16-byte identity of its publisher, if known.
        """
        for each in message.transforms:
            try:
                self._add(each, static, publisher)
            except ValueError:
                self.refused += 1

    def at(self, target: str, at_ns: int, moving: str = "") -> "Moment":
        """Return the poses of all frames in ``target`` at a time.

        Args:
            target: name of a frame.
            at_ns: a stamp of the transforms' clock, ns.
            moving: suffix of the names of frames that are never valid after their newest message,
                even if they were at rest.
        """
        return Moment(self, plain_frame(target), at_ns, moving)

    def matrix(self, target: str, source: str, at_ns: int) -> Floats:
        """(4, 4) from ``source`` to ``target``, in metres.

        Args:
            target, source: names of frames.
            at_ns: a stamp of the transforms' clock, ns.

        Raises:
            UnknownFrame: they are not connected at that time.
        """
        return self.at(target, at_ns).matrix(source)

    def root(self, frame: str) -> str:
        """Return the root frame above this frame."""
        return self.way(plain_frame(frame))[-1]

    def way(self, frame: str) -> list[str]:
        """Return the frame and its ancestors up to the root; stop after MAX_DEPTH in a loop."""
        way = [frame]
        while frame in self._edges and len(way) < MAX_DEPTH:
            frame = self._edges[frame].parent
            way.append(frame)
        return way

    def in_parent(self, child: str, at_ns: int, holds: bool) -> Floats:
        """Return the (4, 4) transform from a frame to its parent.

        Args:
            child: the frame's name.
            at_ns: a stamp, ns.
            holds: whether a frame at rest remains valid after its newest message.

        Raises:
            UnknownFrame: there is no transform, or none at that time.
        """
        edge = self._edges.get(child)
        if edge is None:
            raise UnknownFrame(f"no transform gives the pose of '{child}'")
        return edge.at(child, at_ns, holds)

    def _add(self, message: Any, static: bool, publisher: bytes) -> None:
        parent, child = plain_frame(message.header.frame_id), plain_frame(message.child_frame_id)
        t, q = message.transform.translation, message.transform.rotation
        pose = np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w], np.float64)
        norm = math.hypot(*pose[3:].tolist())
        if not np.isfinite(pose).all() or abs(norm - 1) > NORM_TOLERANCE or child == parent:
            raise ValueError
        at_ns = stamp_ns(message.header.stamp)
        pose[3:] /= norm
        edge = self._edges.pop(child, None)
        if edge is None or (edge.parent, edge.static) != (parent, static):
            edge = _Edge(parent, static, publisher if edge is None else edge.publisher)
        if len(self._edges) >= MAX_FRAMES:
            self._forget_one()
        self._edges[child] = edge
        edge.add(at_ns, pose, publisher)

    def _forget_one(self) -> None:
        """Drop the moving frame that was not updated for the longest time.

        Raises:
            ValueError: all frames are static.
        """
        oldest = next((child for child, edge in self._edges.items() if not edge.static), None)
        if oldest is None:
            raise ValueError
        gone = {oldest}
        while gone:
            for child in gone:
                self._edges.pop(child, None)
            gone = {c for c, e in self._edges.items() if e.static and e.parent in gone}


class Moment:
    """The poses of frames in a target frame at one time; each transform is looked up once."""

    def __init__(self, tree: FrameTree, target: str, at_ns: int, moving: str) -> None:
        self._tree = tree
        self._target = target
        self._at_ns = at_ns
        self._moving = moving
        self._above = tree.way(target)
        self._found: dict[str, Floats] = {target: np.eye(4)}

    def matrix(self, source: str) -> Floats:
        """(4, 4) from ``source`` to the target, in metres.

        Raises:
            UnknownFrame: they are not connected at that time.
        """
        source = plain_frame(source)
        if source in self._found:
            return self._found[source]
        way = self._tree.way(source)
        for frames in (way, self._above):
            if len(set(frames)) < len(frames):  # two parents contradict each other
                raise UnknownFrame(
                    f"the frames above '{frames[0]}' form a loop; stop one of their publishers and "
                    "restart the node"
                )
        known = next((k for k, f in enumerate(way) if f in self._found or f in self._above), None)
        if known is None:
            raise UnknownFrame(f"no transform connects '{source}' to '{self._target}'")
        matrix = self._of_above(way[known])
        for child in reversed(way[:known]):
            below: Floats = matrix @ self._in_parent(child)
            matrix = self._found[child] = below
        return matrix

    def _of_above(self, frame: str) -> Floats:
        """Return the (4, 4) transform from a frame that was found before or is above the target."""
        if frame not in self._found:
            matrix = np.eye(4)
            for child in self._above[: self._above.index(frame)]:
                matrix = self._in_parent(child) @ matrix
            self._found[frame] = np.asarray(np.linalg.inv(matrix), np.float64)
        return self._found[frame]

    def _in_parent(self, child: str) -> Floats:
        holds = not (self._moving and child.endswith(self._moving))
        return self._tree.in_parent(child, self._at_ns, holds)


def plain_frame(name: str) -> str:
    """Return a frame's name without the leading slash of ROS 1."""
    return name.removeprefix("/")


def _alike(pose: Floats, other: Floats) -> bool:
    sign = 1.0 if pose[3:] @ other[3:] >= 0 else -1.0
    turned = np.abs(pose[3:] - sign * other[3:])
    return bool((np.abs(pose[:3] - other[:3]) <= STILL_M).all() and (turned <= STILL).all())


def _between(before: Floats, after: Floats, share: float) -> Floats:
    """Interpolate two poses linearly; the quaternion along the shorter arc, then normalised."""
    sign = 1.0 if before[3:] @ after[3:] >= 0 else -1.0
    pose: Floats = before + share * (np.concatenate([after[:3], sign * after[3:]]) - before)
    norm = np.linalg.norm(pose[3:])
    pose[3:] = pose[3:] / norm if norm > 0 else before[3:]
    return pose


def _matrix(pose: Floats) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_of(pose[3:])
    matrix[:3, 3] = pose[:3]
    return matrix
