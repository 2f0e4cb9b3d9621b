"""Reads only the requested part of a recording.

Chunks of other times are skipped unread, and messages of other topics are not decoded: half a
minute of an hour is found in a fraction of a second, and the advice of an hour in seconds. The CRC
of each chunk that is read is checked as always.
"""

import struct
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, Message, Metadata
from mcap.stream_reader import get_chunk_data_stream, read_magic

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
