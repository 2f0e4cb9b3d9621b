"""Messages between the node and its OPC UA server's process, one datagram each."""

import struct

from hri_drivers.links.plant.image import Block

READY, FAILED, COUNTS, SAID, PRESSED = b"R", b"F", b"C", b"S", b"P"
"""From the server: open (with its port), an error, counts (refused requests, timeouts of advice), a
log line, a press.
"""
MOST = 4096  # bytes
_BLOCK = struct.Struct(">QH")
_NUMBER = struct.Struct(">Q")


def packed_block(block: Block, now_ns: int) -> bytes:
    """Return a block of the map and its time of writing, on the machine's monotonic clock."""
    return _BLOCK.pack(now_ns, block.address) + block.data


def unpacked_block(data: bytes) -> tuple[Block, int]:
    """Return the block and the time."""
    now_ns, address = _BLOCK.unpack_from(data)
    return Block(address, data[_BLOCK.size :]), now_ns


def number(value: int) -> bytes:
    """Return a message with a count or a port."""
    return _NUMBER.pack(value)


def number_of(data: bytes, index: int = 0) -> int:
    """Return the count or port in a message after its first byte, or a later one."""
    found: int = _NUMBER.unpack_from(data, 1 + index * _NUMBER.size)[0]
    return found
