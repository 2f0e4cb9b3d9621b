"""Convert the people in a ROS message to one frame, even if the publisher uses another frame."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import transform
from hri_predict.protocol.ros.bodies import (
    MARKER_ARRAY,
    POSE_ARRAY,
    Bodies,
    Body,
    MessageError,
    of_marker_array,
    of_pose_array,
)
from hri_predict.protocol.ros.frame_tree import FrameTree, UnknownFrame, plain_frame
from hri_predict.protocol.ros.tracked import IDS_LIST, ROOT, Numbers, of_ids_list
from hri_predict.protocol.ros.zed import OBJECTS, of_objects

READERS: dict[str, Callable[[Any, Sequence[str]], Bodies]] = {
    POSE_ARRAY: of_pose_array,
    MARKER_ARRAY: of_marker_array,
    IDS_LIST: of_ids_list,
    OBJECTS: of_objects,
}
"""Parser for each message type with positions of people; arguments: message and joint names."""


class NotYet(MessageError):
    """A required transform may still arrive."""


class PeopleReader:
    """Converts messages to bodies in one frame.

    Args:
        joints: names of a person's joints.
        frame: name of the target frame.
        tree: the transforms, in metres.
        scale_to_m: metres per unit of the messages' positions; 1 by REP-103.
    """

    def __init__(
        self, joints: Sequence[str], frame: str, tree: FrameTree, scale_to_m: float = 1.0
    ) -> None:
        self._joints = tuple(joints)
        self._frame = plain_frame(frame)
        self._tree = tree
        self._scale = scale_to_m
        self._numbers = Numbers()

    def parse(self, kind: str, message: Any) -> Bodies:
        """Return the people in the frame and units of the message.

        Args:
            kind: the message's type, a key of ``READERS``.
            message: with the attributes of that type.

        Raises:
            MessageError: the message does not give positions of people; one line with the remedy.
        """
        return READERS[kind](message, self._joints)

    def place(self, bodies: Bodies, *, waits: bool = False) -> Bodies:
        """Return parsed people in ``frame``, metres.

        Args:
            bodies: result of ``parse``.
            waits: whether transforms may still arrive.

        Raises:
            NotYet: a required transform has not arrived yet; only with ``waits``.
            MessageError: the message's frame is not connected to ``frame``, or a body has no frame
                that is; one line with the remedy.
        """
        if bodies.stamp_ns is None:  # without a header: nobody in any frame
            return bodies
        if not bodies.by_frames:
            matrix = self._matrix(bodies.frame, bodies.stamp_ns, waits)
            people = tuple(
                replace(p, positions=transform(matrix, p.positions * self._scale))
                for p in bodies.people
            )
            return replace(bodies, frame=self._frame, people=people)
        people = tuple(self._by_frames(p, bodies.stamp_ns, waits) for p in bodies.people)
        return replace(bodies, frame=self._frame, people=people)

    def _matrix(self, frame: str, stamp_ns: int, waits: bool) -> Floats:
        if not frame:
            raise MessageError("frame_id is empty; configure the publisher to name its frame")
        try:
            return self._tree.matrix(self._frame, frame, stamp_ns)
        except UnknownFrame as error:
            kind = NotYet if waits and error.later else MessageError
            raise kind(
                f"frame_id '{frame}' is not '{self._frame}': {error}; publish the transform on "
                f"/tf_static, or correct 'frame'"
            ) from None

    def _by_frames(self, body: Body, stamp_ns: int, waits: bool) -> Body:
        """Return the body with its joints at their frames; joints without a frame were not seen."""
        moment = self._tree.at(self._frame, stamp_ns, moving=f"_{body.name}")
        positions: Floats = np.full((len(self._joints), 3), np.nan)
        why = self._at_its_sensor(body.name, stamp_ns)
        for k, joint in enumerate(() if why else self._joints):
            try:
                positions[k] = moment.matrix(f"{joint}_{body.name}")[:3, 3]
            except UnknownFrame as error:
                if waits and error.later:
                    raise NotYet(str(error)) from None
                why = why or str(error)
        if np.isnan(positions).all():
            raise MessageError(f"body '{body.name}' has no place: {why}")
        return replace(body, id=self._numbers.of(body.name), positions=positions)

    def _at_its_sensor(self, name: str, stamp_ns: int) -> str:
        """Return why a body's position is not measured: without depth it stays at the sensor."""
        child = f"{ROOT}_{name}"
        try:
            place = self._tree.in_parent(child, stamp_ns, holds=False)[:3, 3]
        except UnknownFrame:
            return ""  # the joints' frames say why
        if place.any():
            return ""
        return f"'{child}' is at its sensor; give the tracker depth (hri_body_detect: use_depth)"
