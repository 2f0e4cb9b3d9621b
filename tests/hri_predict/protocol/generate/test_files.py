"""Every file that follows from the definition of the messages is the one that it gives now."""

from pathlib import Path

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.protocol.generate import blocks, c_header, document, st_messages
from hri_predict.protocol.generate.files import COMMAND, generated

DRIVERS = Path(__file__).resolve().parents[4] / "drivers"


def test_no_committed_file_is_stale() -> None:
    texts = generated(DRIVERS)
    stale = [p.name for p, text in texts.items() if p.read_text(encoding="utf-8") != text]
    assert not stale, f"run: {COMMAND}"


def test_each_generated_part_has_its_place() -> None:
    text = (DRIVERS / "PROTOCOL.md").read_text(encoding="utf-8")
    assert set(blocks.names(text, blocks.DOCUMENT)) == set(document.BLOCKS)
    files = ("hri_predict.h", "hri_decode.c", "examples/decode.c")
    parts = [n for f in files for n in blocks.names((DRIVERS / "c" / f).read_text())]
    assert sorted(parts) == sorted(c_header.BLOCKS)


def test_a_part_between_two_marks_is_written_again_and_the_rest_is_kept() -> None:
    mark = "/* generated: begin kinds (renew: COMMAND) */\n"
    end = "/* generated: end */\nafter"
    assert blocks.renewed(f"before\n{mark}old\n{end}", {"kinds": lambda: "new\n"}) == (
        f"before\n{mark}new\n{end}"
    )


def test_a_part_without_a_writer_is_an_error() -> None:
    with pytest.raises(ConfigError, match="no table 'nonsense'; available: Acknowledge"):
        blocks.renewed("<!-- table: nonsense -->\n<!-- end -->", document.BLOCKS, blocks.DOCUMENT)


def test_structured_text_has_room_for_the_longest_frame_that_it_takes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = (DRIVERS / "plc" / "hri_serial.st").read_text(encoding="utf-8")
    today = f"ARRAY[0..{st_messages.MAX_ENCODED - 1}] OF BYTE"
    monkeypatch.setattr(st_messages, "MAX_ENCODED", 80)
    renewed = st_messages.renewed(text)
    assert "LONGEST : UINT := 80;" in renewed
    assert renewed.count("ARRAY[0..79] OF BYTE") == text.count(today) == 5
