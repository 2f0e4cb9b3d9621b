"""Reads the node's own recordings; a truncated one is read up to the cut."""

import json
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader, get_chunk_data_stream, read_magic

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.link import Received
from hri_predict.contracts.scene import Scene
from hri_predict.recording.mcap.format import MAX_COUNT, received_from_dict, scene_from_dict, whole
from hri_predict.recording.mcap.info import METADATA, RecordingInfo
from hri_predict.recording.recording import Recording, check_gaps

_RECORD_LIMIT = 64 * 1024 * 1024  # ours have 64 KiB; a damaged length must not fill the memory
# Exceptions that a cut or damaged file can raise.
CUT: tuple[type[Exception], ...] = (EndOfFile, EOFError, McapError, CRCValidationError)
CUT += (struct.error, zlib.error, zstandard.ZstdError, ValueError, IndexError, KeyError)
CUT += (OverflowError, RuntimeError, MemoryError, TypeError)


def read_mcap(path: Path) -> Recording:
    """Read one of the node's own recordings.

    From a file that was cut (the node was killed, the disk was full), everything before the cut is
    read, and ``note`` says so.

    Raises:
        RecordingError: the file is not MCAP, does not come from this node, has no scene, or has
            damaged messages.
    """
    info: RecordingInfo | None = None
    scenes: list[Scene] = []
    arrivals: list[int] = []
    received: list[tuple[str, Received]] = []
    utc: list[int] = []
    topics: dict[int, str] = {}
    note = ""
    with path.open("rb") as file:
        found = records(file)
        while True:
            try:
                record = next(found, None)
            except InvalidMagic as error:
                if info is None:
                    raise RecordingError(f"recording {path}: not an MCAP file") from error
                note = _cut_note(arrivals)
                break
            except CUT:
                note = _cut_note(arrivals)
                break
            if record is None or isinstance(record, Footer):
                break
            if isinstance(record, Metadata) and record.name == METADATA and info is None:
                info = _info(path, record)
            elif isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message) and info is not None:
                _take(
                    path=path,
                    topic=topics.get(record.channel_id),
                    record=record,
                    info=info,
                    scenes=scenes,
                    arrivals=arrivals,
                    received=received,
                    utc=utc,
                )
    if info is None:
        raise RecordingError(
            f"recording {path}: {'truncated' if note else 'was not recorded by hri-predict'}; "
            f"an .mcap to replay comes from 'run --record' or 'replay --record'"
        )
    if not scenes:
        how = "truncated before its first scene" if note else "is empty (no scenes)"
        raise RecordingError(f"recording {path}: {how}; record it again")
    check_gaps(path, arrivals)
    return Recording(
        path=path,
        kind="mcap",
        joint_map=info.joint_map,
        rate_hz=info.rate_hz,
        scenes=scenes,
        arrival_ns=arrivals,
        declares_noise=info.declares_noise,
        received=received,
        note=note,
        config=info.config,
        last_latch_id=info.last_latch_id,
        utc_ns=utc if info.has_utc else (),
        in_room=info.in_room,
        outputs_ns=(-MAX_COUNT, MAX_COUNT),
    )


def records(
    file: Any,
    start_ns: int | None = None,
    end_ns: int | None = None,
    is_wanted: Callable[[str], bool] | None = None,
) -> Iterator[Any]:
    """The records of a file, chunks unpacked; those outside the log times stay packed.

    The first chunk is always unpacked: it names the channels. ``is_wanted``, of a topic: messages
    of others are left out.

    Raises:
        one of ``CUT``: the file ends here, or is damaged.
    """
    found: Iterator[Any]
    unpacker = Unpacker(is_wanted)
    if start_ns is None and end_ns is None and is_wanted is None:
        found = StreamReader(
            file, emit_chunks=True, validate_crcs=True, record_size_limit=_RECORD_LIMIT
        ).records
    else:
        found = within(file, start_ns, end_ns, _RECORD_LIMIT)
    for record in found:
        if isinstance(record, Chunk):
            _check_unpacked(record)
            yield from unpacker.records(record)
        else:
            if isinstance(record, Channel):
                unpacker.see(record)
            yield record


def _check_unpacked(chunk: Chunk) -> None:
    """Reject data that would fill the memory, because a few bytes may unpack to any size.

    Raises:
        ValueError, zstandard.ZstdError: too large when unpacked, or not packed as ours are.
    """
    sizes = [chunk.uncompressed_size]
    if chunk.compression == "zstd":
        said = zstandard.get_frame_parameters(chunk.data).content_size
        sizes += [said] if said != zstandard.CONTENTSIZE_UNKNOWN else []
    elif chunk.compression:
        raise ValueError(f"compression {chunk.compression[:20]!r}")
    if max(sizes) > _RECORD_LIMIT:
        raise ValueError(f"a chunk of {max(sizes)} bytes when unpacked")


def _cut_note(arrivals: list[int]) -> str:
    seconds = (arrivals[-1] - arrivals[0]) * 1e-9 if arrivals else 0.0
    return f"cut or damaged after {seconds:.1f} s ({len(arrivals)} scenes); what follows is lost"


def _info(path: Path, record: Metadata) -> RecordingInfo:
    try:
        return RecordingInfo.from_metadata(record.metadata)
    except RecordingError as error:
        raise RecordingError(f"recording {path}: {error}") from error


def _take(
    *,
    path: Path,
    topic: str | None,
    record: Message,
    info: RecordingInfo,
    scenes: list[Scene],
    arrivals: list[int],
    received: list[tuple[str, Received]],
    utc: list[int],
) -> None:
    """Keep a message that a replay needs."""
    if topic not in ("/scene", "/received"):
        return
    try:
        data = json.loads(record.data)
        if topic == "/scene":
            scene, arrival_ns = scene_from_dict(data, len(info.joint_map.source_joints))
            scenes.append(scene)
            arrivals.append(arrival_ns)
            utc.append(record.log_time)
        else:
            message, received_ns = received_from_dict(data), whole(data["received_ns"])
            if message is not None:
                received.append((str(data["link"]), Received(message, received_ns)))
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise RecordingError(
            f"recording {path}: a message on {topic} is damaged ({error}); record it again"
        ) from error


_HEAD = struct.Struct("<BQ")
_TIMES = struct.Struct("<QQ")
_MESSAGE = struct.Struct("<HIQQ")
_READ: dict[int, Any] = {
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
    Opcode.FOOTER: Footer.read,
}


def within(
    file: BinaryIO, start_ns: int | None, end_ns: int | None, limit: int
) -> Iterator[Chunk | Channel | Metadata | Footer]:
    """Chunks that may hold messages from ``start_ns`` to before ``end_ns``, packed, and the
    records outside chunks. The first chunk is always given: it names the channels.

    Chunks of other times are skipped unread, and messages of other topics are not decoded: half a
    minute of an hour is found in a fraction of a second, and the advice of an hour in seconds. The
    CRC of each chunk that is read is checked as always.

    Raises:
        EndOfFile, ValueError, struct.error, …: the file ends here, is damaged, or a record is
            larger than ``limit`` bytes.
    """
    read_magic(ReadDataStream(file))
    is_first = True
    while True:
        opcode, length = _HEAD.unpack(_exactly(file, _HEAD.size))
        if length > limit:
            raise ValueError(f"a record of {length} bytes")
        if opcode == Opcode.CHUNK and length >= _TIMES.size:
            times = _exactly(file, _TIMES.size)
            first_ns, last_ns = _TIMES.unpack(times)
            early = start_ns is not None and last_ns < start_ns
            late = end_ns is not None and first_ns >= end_ns
            if (early or late) and not is_first:
                file.seek(length - _TIMES.size, 1)
                continue
            is_first = False
            rest = _exactly(file, length - _TIMES.size)
            yield Chunk.read(ReadDataStream(BytesIO(times + rest)))
        elif opcode in _READ:
            record = _READ[opcode](ReadDataStream(BytesIO(_exactly(file, length))))
            yield record
            if opcode == Opcode.FOOTER:
                return
        else:
            file.seek(length, 1)


class Unpacker:
    """Unpacks chunks, in the order of the file.

    Args:
        is_wanted: whether the messages of a topic are wanted; ``None``: all are.
    """

    def __init__(self, is_wanted: Callable[[str], bool] | None = None) -> None:
        self._is_wanted = is_wanted
        self._others: set[int] = set()

    def records(self, chunk: Chunk) -> Iterator[Channel | Message]:
        """The channels of a chunk, and its messages that are wanted.

        Raises:
            CRCValidationError, EndOfFile, struct.error, …: it is damaged.
        """
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        data = stream.read(size)
        at = 0
        while at < size:
            opcode, length = _HEAD.unpack_from(data, at)
            start = at + _HEAD.size
            at = start + length
            if at > size:
                raise EndOfFile
            if opcode == Opcode.MESSAGE:
                number, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(data, start)
                if number not in self._others:
                    content = data[start + _MESSAGE.size : at]
                    yield Message(number, log_ns, content, publish_ns, sequence)
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(data[start:at])))
                self.see(channel)
                yield channel

    def see(self, channel: Channel) -> None:
        """Store a channel that is outside the chunks."""
        if self._is_wanted is not None and not self._is_wanted(channel.topic):
            self._others.add(channel.id)


def _exactly(file: BinaryIO, length: int) -> bytes:
    data = file.read(length)
    if len(data) < length:
        raise EndOfFile
    return data
