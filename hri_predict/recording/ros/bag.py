"""Opens bags of ROS 1 (``.bag``) and ROS 2 (``.db3``, ``.mcap``) by ``rosbags``."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from struct import Struct
from typing import Any

from hri_predict.base.errors import HriPredictError, RecordingError, first_line
from hri_predict.protocol.ros.messages import Release, of_cdr, typestore

BAG_ENDING = ".bag"
METADATA = "metadata.yaml"
_STORAGES = (".db3", ".mcap")
ENDINGS = (BAG_ENDING, *_STORAGES)
_MCAP_START = b"\x89MCAP0\r\n\x01"
_LENGTHS = Struct("<QI")  # of the header record, and of the profile's name
_MAX_PROFILE = 64
_REMEDY = "copy it again, or repair it ('ros2 bag reindex', 'mcap recover', 'rosbag reindex')"


def is_ros_mcap(path: Path) -> bool:
    """Whether an MCAP file states that ROS recorded it, unlike the node's own."""
    with path.open("rb") as file:
        head = file.read(len(_MCAP_START) + _LENGTHS.size + _MAX_PROFILE)
    rest = head.removeprefix(_MCAP_START)
    if rest == head or len(rest) < _LENGTHS.size:
        return False
    _, length = _LENGTHS.unpack_from(rest)
    return rest[_LENGTHS.size :][: min(length, _MAX_PROFILE)].startswith(b"ros")


def file_of(path: Path) -> Path:
    """Return the file in the folder of a ROS 2 bag; any other path unchanged.

    Raises:
        RecordingError: the bag was split into several files, or its file is missing.
    """
    if not (path.is_dir() and (path / METADATA).is_file()):
        return path
    found = sorted(each for each in path.iterdir() if each.suffix in _STORAGES)
    if len(found) == 1:
        return found[0]
    if not found:
        raise RecordingError(
            f"recording {path}: no {' or '.join(_STORAGES)} file; unpack it, or copy it again"
        )
    raise RecordingError(
        f"recording {path}: was split into {len(found)} files; name one of them, such as {found[0]}"
    )


class Bag:
    """An open bag.

    Attributes:
        connections: the bag's; each has ``topic``, ``msgtype`` and ``msgcount``.
    """

    def __init__(self, path: Path, reader: Any) -> None:
        self.connections: list[Any] = list(reader.connections)
        self._path, self._reader = path, reader
        self._is_1 = path.suffix.lower() == BAG_ENDING
        self._store = typestore(self._release())

    def messages(self, connections: Collection[Any]) -> Iterator[tuple[Any, int, bytes]]:
        """Connection, time of its receipt (ns) and bytes of each message, by their times.

        Raises:
            RecordingError: at the end, if the bag counts more messages than could be read: where
                its index is damaged, the reader silently skips messages.
        """
        read, counted = 0, sum(c.msgcount for c in connections)
        if connections:
            for each in self._reader.messages(connections=list(connections)):
                read += 1
                yield each
        if read < counted:
            raise RecordingError(
                f"recording {self._path}: not a whole bag: {read} of {counted} messages can be "
                f"read; {_REMEDY}"
            )

    def read(self, data: bytes, kind: str) -> Any:
        """A message as plain values.

        Raises:
            Exception: any type, if the message is damaged.
        """
        if self._is_1:
            return self._store.deserialize_ros1(data, kind)
        return of_cdr(self._store, data, kind)

    def _release(self) -> Release:
        if self._is_1:
            return "ros1"
        texts = [str(c.msgdef.data) for c in self.connections if "/Marker" in c.msgtype]
        old = any(text and "texture_resource" not in text for text in texts)
        return "foxy" if old else "jazzy"


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a bag.

    Raises:
        ConfigError: rosbags is not installed.
        RecordingError: it is damaged, or not a bag.
    """
    typestore("jazzy")  # says what is missing
    if not path.is_file():
        raise RecordingError(f"recording {path}: no such file, or a folder without {METADATA}")
    if path.suffix.lower() not in ENDINGS:
        raise RecordingError(f"recording {path}: not a ROS bag ({', '.join(ENDINGS)})")
    if path.suffix.lower() == ".mcap" and not is_ros_mcap(path):
        raise RecordingError(
            f"recording {path}: not a bag of ROS; 'hri-predict replay' plays a recording of this "
            "node as it is, and 'convert --to rosbag2' makes a bag of it"
        )
    from rosbags import rosbag1, rosbag2

    kind = rosbag1.Reader if path.suffix.lower() == BAG_ENDING else rosbag2.Reader
    try:
        with kind(path) as reader:
            yield Bag(path, reader)
    except (HriPredictError, OSError):
        raise
    except Exception as error:  # rosbags and what it uses raise many kinds on damaged files
        said = first_line(error)[:120]
        raise RecordingError(f"recording {path}: not a whole bag: {said}; {_REMEDY}") from error
