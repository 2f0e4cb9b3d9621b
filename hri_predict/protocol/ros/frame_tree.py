"""Frames of ``/tf`` and ``/tf_static``: the pose of one frame in another, at a time.

As tf2 (REP-105): each frame has one parent. A transform that moves is interpolated between two
messages, and never extrapolated; after its newest message it holds only while it stands still.
"""

import math
from bisect import bisect_right
from collections import deque
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.protocol.ros.stamps import stamp_ns

MAX_FRAMES = 1000
MAX_DEPTH = 100
HISTORY = 200
"""Transforms of one frame that are kept: 2 s at 100 Hz."""
GAP_NS = 500_000_000
"""Maximum time between two transforms, and after the newest one while it stands still."""
STILL_M, STILL = 0.001, 0.0005
"""Maximum change, metres and of the quaternion (1 mrad), of a transform that stands still."""
NORM_TOLERANCE = 0.01


class UnknownFrame(ValueError):
    """Two frames have no transform at that time; one line with the cause."""


class _Edge:
    """The transforms of one frame in its parent."""

    def __init__(self, parent: str, static: bool) -> None:
        self.parent = parent
        self.static = static
        self.times: deque[int] = deque(maxlen=HISTORY)
        self.poses: deque[Floats] = deque(maxlen=HISTORY)  # (7,) xyz, quaternion xyzw

    def add(self, at_ns: int, pose: Floats) -> None:
        if self.static or (
            self.times and at_ns < self.times[-1] - GAP_NS
        ):  # a clock that restarted
            self.times.clear()
            self.poses.clear()
        if not self.times or at_ns > self.times[-1]:
            self.times.append(at_ns)
            self.poses.append(pose)

    def at(self, child: str, at_ns: int) -> Floats:
        """(4, 4) at a time.

        Raises:
            UnknownFrame: no transform holds then.
        """
        if self.static:
            return _matrix(self.poses[-1])
        k = bisect_right(self.times, at_ns)
        if 0 < k < len(self.times):
            before, after = self.times[k - 1], self.times[k]
            if after - before <= GAP_NS:
                share = (at_ns - before) / (after - before)
                return _matrix(_between(self.poses[k - 1], self.poses[k], share))
        elif k == len(self.times) and at_ns - self.times[-1] <= GAP_NS and self._still():
            return _matrix(self.poses[-1])
        raise UnknownFrame(
            f"the transform of '{child}' in '{self.parent}' has no value at the message's stamp; "
            f"publish it at least 10 times a second by the same clock, or on /tf_static"
        )

    def _still(self) -> bool:
        if len(self.poses) < 2:
            return False
        change = np.abs(self.poses[-1] - self.poses[-2])
        return bool((change[:3] <= STILL_M).all() and (change[3:] <= STILL).all())


class FrameTree:
    """Collects transforms; bounded in frames and in time.

    Attributes:
        refused: transforms that were not valid, or of too many frames.
    """

    def __init__(self) -> None:
        self.refused = 0
        self._edges: dict[str, _Edge] = {}

    def add(self, message: Any, *, static: bool) -> None:
        """Take a ``tf2_msgs/TFMessage``; invalid transforms in it are counted."""
        for each in message.transforms:
            try:
                self._add(each, static)
            except ValueError:
                self.refused += 1

    def matrix(self, target: str, source: str, at_ns: int) -> Floats:
        """(4, 4) from ``source`` to ``target``, in metres.

        Args:
            target, source: names of frames.
            at_ns: a stamp of the transforms' clock, ns.

        Raises:
            UnknownFrame: they are not connected at that time.
        """
        target, source = plain_frame(target), plain_frame(source)
        if target == source:
            return np.eye(4)
        down, up = self._way(target), self._way(source)
        if down[-1] != up[-1]:
            raise UnknownFrame(f"no transform connects '{source}' to '{target}'")
        while len(down) > 1 and len(up) > 1 and down[-2] == up[-2]:
            down.pop()
            up.pop()
        root_from_source = self._along(up, at_ns)
        root_from_target = self._along(down, at_ns)
        result: Floats = np.linalg.inv(root_from_target) @ root_from_source
        return result

    def root(self, frame: str) -> str:
        """The topmost frame above this one."""
        return self._way(plain_frame(frame))[-1]

    def _add(self, message: Any, static: bool) -> None:
        parent, child = plain_frame(message.header.frame_id), plain_frame(message.child_frame_id)
        t, q = message.transform.translation, message.transform.rotation
        pose = np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w], np.float64)
        norm = math.hypot(*pose[3:].tolist())
        if not np.isfinite(pose).all() or abs(norm - 1) > NORM_TOLERANCE or child == parent:
            raise ValueError
        pose[3:] /= norm
        edge = self._edges.get(child)
        if edge is None and len(self._edges) >= MAX_FRAMES:
            raise ValueError
        if edge is None or (edge.parent, edge.static) != (parent, static):
            edge = self._edges[child] = _Edge(parent, static)
        edge.add(stamp_ns(message.header.stamp), pose)

    def _way(self, frame: str) -> list[str]:
        """The frame, its parent, and so on, to the topmost one; a circle ends after MAX_DEPTH."""
        way = [frame]
        while frame in self._edges and len(way) < MAX_DEPTH:
            frame = self._edges[frame].parent
            way.append(frame)
        return way

    def _along(self, way: list[str], at_ns: int) -> Floats:
        """(4, 4) from the first frame of a way to its last."""
        matrix = np.eye(4)
        for child in way[:-1]:
            matrix = self._edges[child].at(child, at_ns) @ matrix
        return matrix


def plain_frame(name: str) -> str:
    """A frame's name without the leading slash of ROS 1."""
    return name.removeprefix("/")


def _between(before: Floats, after: Floats, share: float) -> Floats:
    """A pose between two; the quaternion by the shorter way, normalised (near for small turns)."""
    sign = 1.0 if before[3:] @ after[3:] >= 0 else -1.0
    pose: Floats = before + share * (np.concatenate([after[:3], sign * after[3:]]) - before)
    norm = np.linalg.norm(pose[3:])
    pose[3:] = pose[3:] / norm if norm > 0 else before[3:]
    return pose


def _matrix(pose: Floats) -> Floats:
    x, y, z, w = pose[3:]
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = pose[:3]
    return matrix
