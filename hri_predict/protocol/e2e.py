"""AUTOSAR end-to-end protection, profiles 2, 4 and 5, and the check of the counters.

Source: AUTOSAR Foundation, "E2E Protocol Specification" (PRS_E2EProtocol), profiles 2, 4 and 5 with
offset 0. The CRCs are CRC-8 0x2F (start and final xor 0xFF), CRC-32 0xF4ACFB13 (reflected, start
and final xor 0xFFFFFFFF) and CRC-16 0x1021 (start 0xFFFF).

One extension: on classic CAN the four bits next to profile 2's counter extend it to eight bits.
Byte 1 as a whole counts 0..255; its low nibble is the profile's own counter.
"""

from enum import Enum
from struct import Struct

from fastcrc import crc8, crc16, crc32

MAX_DELTA = 5  # largest accepted advance of the counter: up to four lost in a row
RESYNC = 3  # frames in sequence before a receiver follows a counter that has jumped

PROFILE_2_HEADER = 2
PROFILE_4_HEADER = 12
PROFILE_5_HEADER = 3

_PROFILE_4 = Struct(">HHI")


def data_id_list(number: int) -> bytes:
    """The 16 data ids of profile 2 for the frame ``number``: all are ``number + 1``.

    Each frame has its own data id, so a frame under a wrong CAN id never passes the CRC. All 16 are
    equal, because otherwise a wrong counter bit would change the data id as well. Some errors of
    two and three bits would then pass the CRC, although the polynomial alone detects all of them.
    """
    return bytes((number + 1,)) * 16


def data_id_16(number: int) -> int:
    """Data id for profile 5, implicit in the CRC."""
    return 0x4800 + number


def data_id_32(number: int) -> int:
    """Data id for profile 4, sent in the header."""
    return 0x48520000 + number


def protect_profile2(counter: int, payload: bytes, ids: bytes) -> bytes:
    """Return CRC, ``counter`` (0..255; the low nibble is the profile's counter) and ``payload``."""
    body = bytes((counter,)) + payload
    return bytes((crc8.autosar(body + ids[counter & 15 : (counter & 15) + 1]),)) + body


def check_profile2(frame: bytes, ids: bytes) -> bool:
    """Whether the CRC is correct; false for frames that are too short to contain one."""
    if len(frame) < PROFILE_2_HEADER:
        return False
    nibble = frame[1] & 15
    return crc8.autosar(frame[1:] + ids[nibble : nibble + 1]) == frame[0]


def protect_profile5(counter: int, payload: bytes, data_id: int) -> bytes:
    """Return CRC (little-endian), ``counter`` (0..255) and ``payload``."""
    body = bytes((counter,)) + payload
    return crc16.ibm_3740(body + data_id.to_bytes(2, "little")).to_bytes(2, "little") + body


def check_profile5(frame: bytes, data_id: int) -> bool:
    """Whether the CRC is correct; false for frames that are too short to contain one."""
    if len(frame) < PROFILE_5_HEADER:
        return False
    crc = crc16.ibm_3740(frame[2:] + data_id.to_bytes(2, "little"))
    return crc == frame[0] | frame[1] << 8


def protect_profile4(counter: int, payload: bytes, data_id: int) -> bytes:
    """Return length, ``counter`` (0..65535), data id, CRC (all big-endian) and ``payload``."""
    head = _PROFILE_4.pack(PROFILE_4_HEADER + len(payload), counter, data_id)
    return head + crc32.autosar(head + payload).to_bytes(4, "big") + payload


def check_profile4(frame: bytes) -> bool:
    """Whether CRC and length are correct; the data id (bytes 4..7) identifies the message."""
    if len(frame) < PROFILE_4_HEADER or int.from_bytes(frame[:2], "big") != len(frame):
        return False
    return crc32.autosar(frame[:8] + frame[12:]) == int.from_bytes(frame[8:12], "big")


class Verdict(Enum):
    """Result of checking a message's counter; only OK and SOME_LOST are fresh."""

    OK = "ok"
    SOME_LOST = "some lost"
    REPEATED = "repeated"
    WRONG_SEQUENCE = "wrong sequence"


class CounterCheck:
    """Checks the counters of one stream of messages.

    The first message is fresh, and so is each message that advances the counter by 1..MAX_DELTA.
    After a jump (the sender restarted, the line was down) RESYNC messages with consecutive counters
    must arrive, starting with the first message after the jump; the last of them is fresh again.
    Any other message in between, including a repeated one, ends the sequence. A single old message
    is never fresh.
    """

    __slots__ = ("_candidate", "_last", "_modulus", "_run", "lost")

    def __init__(self, modulus: int):
        self._modulus = modulus
        self.reset()

    def reset(self) -> None:
        """Forget everything; treat the next message as the first."""
        self._last: int | None = None
        self._candidate: int | None = None
        self._run = 0
        self.lost = 0  # messages that the last verdict found missing

    def repeated(self) -> None:
        """End the sequence after a repeated message."""
        self._run = 0

    def check(self, counter: int) -> Verdict:
        """Check the next ``counter``; if it is not fresh, change only the resync state."""
        self.lost = 0
        if self._last is None:
            self._last = counter
            return Verdict.OK
        delta = (counter - self._last) % self._modulus
        if 1 <= delta <= MAX_DELTA:
            self._last, self._run = counter, 0
            self.lost = delta - 1
            return Verdict.SOME_LOST if self.lost else Verdict.OK
        if delta == 0 or (self._run and counter == self._candidate):
            self.repeated()
            return Verdict.REPEATED
        follows = self._candidate is not None and (counter - self._candidate) % self._modulus == 1
        self._run = self._run + 1 if self._run and follows else 1
        self._candidate = counter
        if self._run < RESYNC:
            return Verdict.WRONG_SEQUENCE
        self._last, self._run = counter, 0
        return Verdict.OK
