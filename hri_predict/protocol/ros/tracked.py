"""ROS4HRI (REP-155): ``hri_msgs/IdsList`` on ``/humans/bodies/tracked``.

The message names the tracked bodies; their frames in ``/tf`` give the positions. For example, the
joint ``l_wrist`` of the body ``abcde`` is at the origin of the frame ``l_wrist_abcde``.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hri_predict.protocol.ros.bodies import Bodies, Body, MessageError, check_people, stamp

ROOT = "body"
"""Name prefix of the body frame that the tracker publishes relative to the sensor."""
IDS_LIST = "hri_msgs/msg/IdsList"
IDS_LIST_TEXT = "std_msgs/Header header\nstring[] ids"
"""Definition of the message (github.com/ros4hri/hri_msgs)."""
_REMEMBERED = 1024


def of_ids_list(message: Any, names: Sequence[str]) -> Bodies:
    """Return the tracked bodies without positions, numbered by their index in the list.

    Raises:
        MessageError: an empty id, a repeated id, or too many people.
    """
    ids = [str(each) for each in message.ids]
    check_people(len(ids))
    if len(set(ids)) < len(ids) or "" in ids:
        raise MessageError("an id is empty or repeated; correct the tracker")
    nowhere = np.full((len(names), 3), np.nan)
    people = tuple(Body(k, nowhere, name) for k, name in enumerate(ids))
    return Bodies(stamp_ns=stamp(message.header), frame="", people=people, by_frames=True)


class Numbers:
    """Assigns a number to each name; a name keeps its number while it is seen, and long after."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}  # in the order in which they were seen last
        self._next = 1

    def of(self, name: str) -> int:
        """Return a number, 0..65535, that no other recently seen name has."""
        number = self._numbers.pop(name, None)
        if number is None:
            taken = set(self._numbers.values())
            while self._next in taken:
                self._next = (self._next + 1) % 65_536
            number = self._next
            self._next = (number + 1) % 65_536
        self._numbers[name] = number
        while len(self._numbers) > _REMEMBERED:
            del self._numbers[next(iter(self._numbers))]
        return number
