"""A bag's description of itself, where this node wrote it: joints, frame and configuration.

It is a message on a topic of its own, which every storage of a bag can hold.
"""

import json
from pathlib import Path

from hri_predict.base.errors import RecordingError
from hri_predict.recording.mcap.info import RecordingInfo
from hri_predict.recording.ros.bag import Bag, open_bag

PREFIX = "/recorded"
"""Prefix of all topics that this node writes into a bag."""
ABOUT, PEOPLE = f"{PREFIX}/about", f"{PREFIX}/people"
STRING = "std_msgs/msg/String"
MAX_BYTES = 4 * 1024 * 1024


def is_in_room(path: Path) -> bool:
    """Whether a bag was made from a recording of this node, with people in the room's frame.

    Raises:
        RecordingError: it cannot be read.
    """
    with open_bag(path) as bag:
        said = about(path, bag)
    return said is not None and bool(said.config)


def about(path: Path, bag: Bag) -> RecordingInfo | None:
    """Return the description; ``None``: this node did not write the bag.

    Raises:
        RecordingError: it is damaged, or there are several that differ.
    """
    own = [c for c in bag.connections if c.topic == ABOUT and c.msgtype == STRING]
    first: bytes | None = None
    for _, _, data in bag.messages(own):
        if first is None:
            first = bytes(data)
        elif first != data:
            raise RecordingError(
                f"recording {path}: the messages on {ABOUT} differ: bags of several recordings "
                "were merged; replay each alone"
            )
    return None if first is None else _description(path, bag, first)


def _description(path: Path, bag: Bag, data: bytes) -> RecordingInfo:
    what = f"recording {path}: the message on {ABOUT}"
    try:
        if len(data) > MAX_BYTES:
            raise ValueError(f"more than {MAX_BYTES} bytes")
        said = json.loads(bag.read(data, STRING).data)
        return RecordingInfo.from_metadata({str(k): str(v) for k, v in said.items()})
    except RecordingError as error:
        raise RecordingError(f"{what}: {error}") from error
    except Exception as error:  # of rosbags and json: many kinds
        raise RecordingError(f"{what} is damaged ({error}); convert it again") from error
