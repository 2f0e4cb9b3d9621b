"""drivers/PROTOCOL.md says what the definition says, and its example is true."""

import re
from pathlib import Path

from hri_predict.protocol.generate.examples import EXAMPLES
from hri_predict.protocol.messages import Advice, Level

EXAMPLE = next(m for m in EXAMPLES if isinstance(m, Advice))
DOCUMENT = Path(__file__).resolve().parents[4] / "drivers" / "PROTOCOL.md"


def crc(data: bytes, width: int, polynomial: int, start: int) -> int:
    """Bit by bit, not reflected, without final XOR, as the document describes it."""
    value = start
    for byte in data:
        value ^= byte << (width - 8)
        for _ in range(8):
            top = value >> (width - 1)
            value = (value << 1) & ((1 << width) - 1)
            if top:
                value ^= polynomial
    return value


def example_bytes(link: str) -> list[bytes]:
    text = DOCUMENT.read_text(encoding="utf-8").partition("<!-- table: Advice example -->")[2]
    text = text.partition("<!-- end -->")[0]
    rows = re.findall(rf"^\| {link}[^|]*\| `([0-9A-F ]+)` \|$", text, re.MULTILINE)
    return [bytes.fromhex(row) for row in rows]


def test_classic_example_follows_the_words_alone() -> None:
    frames = example_bytes("classic")
    assert len(frames) == 3
    for part, frame in enumerate(frames):
        number = 8 * EXAMPLE.robot + part
        data_id = number + 1
        want = crc(frame[1:] + bytes((data_id,)), 8, 0x2F, 0xFF) ^ 0xFF
        assert frame[0] == want
        assert frame[1] == 0
    payload = b"".join(frame[2:] for frame in frames)
    assert payload[0] == Level.SLOW
    assert int.from_bytes(payload[2:4], "little") / 1000 == EXAMPLE.speed_limit_m_s


def test_fd_example_follows_the_words_alone() -> None:
    (frame,) = example_bytes("FD")
    data_id = 0x4800 + 8 * EXAMPLE.robot
    body = frame[2:] + bytes((data_id & 0xFF, data_id >> 8))
    assert int.from_bytes(frame[:2], "little") == crc(body, 16, 0x1021, 0xFFFF)
    assert frame[3:21] == b"".join(f[2:] for f in example_bytes("classic"))
