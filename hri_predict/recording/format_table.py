"""Table of the recording formats. Readers, writers, endings, help and checks are derived
from it.

A new format is a module in ``formats`` and a row here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hri_predict.recording.bounded import names_in_zip
from hri_predict.recording.formats.amass import is_amass, read_amass, write_amass
from hri_predict.recording.formats.bvh import read_bvh
from hri_predict.recording.formats.bvh_writer import write_bvh
from hri_predict.recording.formats.c3d import read_c3d, write_c3d
from hri_predict.recording.formats.csv_table import is_recording, read_csv, write_csv
from hri_predict.recording.formats.mcap_writer import write_mcap
from hri_predict.recording.formats.npy import read_npy
from hri_predict.recording.formats.npz import read_npz, write_pack
from hri_predict.recording.formats.openpose import read_openpose
from hri_predict.recording.formats.pw3d import KEY, names_3dpw, read_3dpw
from hri_predict.recording.formats.trc import read_trc, write_trc
from hri_predict.recording.frames import Written
from hri_predict.recording.mcap.reader import read_mcap
from hri_predict.recording.recording import Recording
from hri_predict.recording.ros.bag import is_ros_mcap
from hri_predict.recording.ros.people import read_bag
from hri_predict.recording.ros.writing import write_bag_mcap, write_bag_sqlite
from hri_predict.recording.wanted import Wanted

Reader = Callable[[Path, Wanted], Recording]


def _anything(path: Path) -> bool:
    return True


def _begins(magic: bytes) -> Callable[[Path, bytes], bool]:
    """Return a test of the first bytes; a text may begin with a byte-order mark and with blanks."""
    return lambda path, head: head.startswith(magic) or _text(head).startswith(magic)


def _is_npz(path: Path, head: bytes) -> bool:
    if not head.startswith(b"PK\x03\x04"):
        return False
    names = names_in_zip(path) or ()
    return bool(names) and all(name.endswith(".npy") for name in names)


def _is_c3d(path: Path, head: bytes) -> bool:
    return len(head) >= 512 and head[1] == 0x50 and head[0] > 1


def _is_table(path: Path, head: bytes) -> bool:
    if b"\0" in head or _text(head).startswith((b"{", b"[", b"<")):
        return False
    first = _text(head).split(b"\n", 1)[0]
    return max(first.count(b","), first.count(b";"), first.count(b"\t")) >= 2


def _text(head: bytes) -> bytes:
    return head.removeprefix(b"\xef\xbb\xbf").lstrip()


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """One format.

    Attributes:
        name: name of the format in ``convert --to``.
        ending: suffix of the files. If several formats share a suffix, the first one writes where
            only the suffix is given, and the first one whose ``is_mine`` holds reads.
        read, write: reader and writer; without a writer, the format is read-only.
        looks: whether a file looks like this format, by its path and first bytes; used only in
            messages.
        content: name of such content in messages.
        only: which files of this ending are read; "" for all.
        is_mine: whether a file of this ending is this format's.
        may_lack_times: whether such files may need ``rate_hz``.
        in_folders: whether a file of this ending counts as a recording of the folder it is in;
            ``None``: each does.
    """

    name: str
    ending: str
    read: Reader
    looks: Callable[[Path, bytes], bool]
    content: str
    write: Callable[[Path, Recording], Written] | None = None
    only: str = ""
    is_mine: Callable[[Path], bool] = _anything
    may_lack_times: bool = False
    in_folders: Callable[[Path], bool] | None = None


FORMATS = (
    Format(
        name="amass",
        ending=".npz",
        read=read_amass,
        write=write_amass,
        looks=_is_npz,
        content="NumPy",
        only="AMASS with joints",
        is_mine=is_amass,
    ),
    Format(
        name="pack",
        ending=".npz",
        read=read_npz,
        write=write_pack,
        looks=_is_npz,
        content="NumPy",
        only="the data pack's layouts",
    ),
    Format(
        name="bvh",
        ending=".bvh",
        read=read_bvh,
        write=write_bvh,
        looks=_begins(b"HIERARCHY"),
        content="BVH",
    ),
    Format(
        name="c3d",
        ending=".c3d",
        read=read_c3d,
        write=write_c3d,
        looks=_is_c3d,
        content="C3D",
    ),
    Format(
        name="trc",
        ending=".trc",
        read=read_trc,
        write=write_trc,
        looks=_begins(b"PathFileType"),
        content="markers as OpenSim's TRC",
    ),
    Format(
        name="csv",
        ending=".csv",
        read=read_csv,
        write=write_csv,
        looks=_is_table,
        content="a table as text",
        may_lack_times=True,
        in_folders=is_recording,
    ),
    Format(
        name="openpose",
        ending=".json",
        read=read_openpose,
        looks=lambda path, head: b'"people"' in head,
        content="OpenPose's keypoints",
        only="OpenPose's, or their folder",
        may_lack_times=True,
        in_folders=lambda path: False,  # needs a rate, which only convert takes
    ),
    Format(
        name="freemocap",
        ending=".npy",
        read=read_npy,
        looks=_begins(b"\x93NUMPY"),
        content="a single NumPy array",
        only="FreeMoCap's",
        may_lack_times=True,
        in_folders=lambda path: False,
    ),
    Format(
        name="3dpw",
        ending=".pkl",
        read=read_3dpw,
        looks=lambda path, head: KEY.encode() in head,
        content="3DPW's pickle",
        only="3DPW's",
        in_folders=names_3dpw,
    ),
    Format(
        name="rosbag1",
        ending=".bag",
        read=read_bag,
        looks=_begins(b"#ROSBAG"),
        content="a bag of ROS 1",
        only="ROS 1",
    ),
    Format(
        name="rosbag2-sqlite",
        ending=".db3",
        read=read_bag,
        write=write_bag_sqlite,
        looks=_begins(b"SQLite format 3\0"),
        content="SQLite, such as a bag of ROS 2",
        only="ROS 2",
    ),
    Format(
        name="mcap",
        ending=".mcap",
        read=lambda path, wanted: read_mcap(path),
        write=write_mcap,
        looks=_begins(b"\x89MCAP0\r\n"),
        content="MCAP",
        only="recorded by this node",
        is_mine=lambda path: not is_ros_mcap(path),
    ),
    Format(
        name="rosbag2",
        ending=".mcap",
        read=read_bag,
        write=write_bag_mcap,
        looks=lambda path, head: False,  # as the one before
        content="a bag of ROS 2",
        only="ROS 2",
    ),
)
BY_NAME = {
    each.name: each
    for each in sorted(FORMATS, key=lambda each: each.name)
    if each.write is not None
}
"""The formats that can be written."""
ENDINGS = tuple(dict.fromkeys(each.ending for each in FORMATS))
ANY_ENDING = f"{', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"


def of_ending(ending: str) -> list[Format]:
    """Return the formats of files with this ending, such as ".npz"; empty if it is unknown."""
    return [each for each in FORMATS if each.ending == ending]


def counts_in_folder(path: Path) -> bool:
    """Whether a file with a known ending is one of its folder's recordings.

    Raises:
        RecordingError: it appears to be intended as a recording, but is not valid.
        OSError: it cannot be read.
    """
    asked = [each.in_folders for each in of_ending(path.suffix.lower())]
    return any(ask is None or (path.is_file() and ask(path)) for ask in asked)
