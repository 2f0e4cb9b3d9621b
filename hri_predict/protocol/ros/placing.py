"""People of a ROS message in one frame, also where the publisher uses another."""

from dataclasses import replace
from typing import Any

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import transform
from hri_predict.protocol.ros.bodies import READERS, Bodies, MessageError
from hri_predict.protocol.ros.frame_tree import FrameTree, UnknownFrame, plain_frame


class PeopleReader:
    """Turns messages into bodies in one frame.

    Args:
        joints: number of joints of a person.
        frame: name of the frame in which people are wanted.
        tree: the transforms, in metres.
        scale_to_m: metres per unit of the messages' positions; 1 by REP-103.
    """

    def __init__(self, joints: int, frame: str, tree: FrameTree, scale_to_m: float = 1.0) -> None:
        self._joints = joints
        self._frame = plain_frame(frame)
        self._tree = tree
        self._scale = scale_to_m

    def read(self, kind: str, message: Any) -> Bodies:
        """People in metres in ``frame``.

        Args:
            kind: the message's type, a key of ``READERS``.
            message: with the attributes of that type.

        Raises:
            MessageError: the message does not place people, or its frame is not connected to
                ``frame``; one line with the remedy.
        """
        bodies = READERS[kind](message, self._joints)
        if bodies.stamp_ns is None:  # without a header: nobody in any frame
            return bodies
        matrix = self._matrix(bodies.frame, bodies.stamp_ns)
        people = tuple(
            replace(p, positions=transform(matrix, p.positions * self._scale))
            for p in bodies.people
        )
        return replace(bodies, frame=self._frame, people=people)

    def _matrix(self, frame: str, stamp_ns: int) -> Floats:
        if not frame:
            raise MessageError("frame_id is empty; let the publisher name its frame")
        try:
            return self._tree.matrix(self._frame, frame, stamp_ns)
        except UnknownFrame as error:
            raise MessageError(
                f"frame_id '{frame}' is not '{self._frame}': {error}; publish the transform on "
                f"/tf_static, or correct 'frame'"
            ) from None
