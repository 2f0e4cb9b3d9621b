"""``protocol`` writes what ships, and says in one line what it cannot do."""

import shutil
from functools import partial
from pathlib import Path

import pytest

from hri_predict.protocol.generate.files import generated
from hri_predict.protocol.generate.structured_text import FILES
from tests.commands import status_of

DRIVERS = Path(__file__).resolve().parents[3] / "drivers"
C_FILES = ("c/hri_predict.h", "c/hri_decode.c", "c/examples/decode.c")
ST_FILES = tuple(f"plc/{name}" for name in FILES)


protocol = partial(status_of, "protocol")


@pytest.mark.parametrize(
    ("command", "written"),
    [
        ("files", [*(str(p.relative_to(DRIVERS)) for p in generated(DRIVERS))]),
        ("dbc", ["dbc/hri_predict.dbc", "dbc/hri_predict_fd.dbc"]),
        ("document", ["PROTOCOL.md"]),
        ("c-header", [*C_FILES, "c/fuzz/corpus.txt"]),
        ("plcopen", [*ST_FILES, "plc/hri_predict.xml", "plc/hri_predict.scl"]),
    ],
)
def test_each_says_what_it_wrote_which_is_what_ships(tmp_path, capsys, command, written):
    own = tmp_path / "drivers"
    for folder in ("c/fuzz", "c/examples", "dbc", "plc"):
        (own / folder).mkdir(parents=True)
    for name in ("PROTOCOL.md", "MODBUS.md", "OPCUA.md", *C_FILES, *ST_FILES):
        text = (DRIVERS / name).read_text(encoding="utf-8")
        text = text.replace("#define HRI_LEVEL_", "#define HRI_OLD_")
        at = text.find("<!-- table: levels -->\n")
        text = text[:at] + text[at:].replace("\n|", "\n| x |", 3) if at >= 0 else text
        (own / name).write_text(text, encoding="utf-8")
    where = {"files": "", "document": "PROTOCOL.md"}.get(command, Path(written[0]).parent)
    assert protocol(command, own / where) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "written: " + ", ".join(str(own / name) for name in written) + "\n"
    for name in written:
        assert (own / name).read_bytes() == (DRIVERS / name).read_bytes(), name


def test_a_base_id_may_be_written_in_hex(tmp_path):
    assert protocol("dbc", tmp_path, "--base-id", "0x100") == 0
    text = (tmp_path / "hri_predict.dbc").read_text(encoding="ascii")
    assert f"\nBO_ {0x100} " in text


def test_structured_text_that_is_none_is_one_line(tmp_path, capsys):
    for name in ST_FILES:
        shutil.copy(DRIVERS / name, tmp_path)
    source = tmp_path / "hri_advice.st"
    source.write_text("FUNCTION X : INT\nVAR\nA, B : INT;\nEND_VAR\nEND_FUNCTION\n")
    assert protocol("plcopen", tmp_path) == 2
    assert "X: cannot parse the declaration: A, B : INT;" in capsys.readouterr().err
    source.write_text("nothing")
    assert protocol("plcopen", tmp_path) == 2
    assert "hri_advice.st: it has no FUNCTION" in capsys.readouterr().err
    assert protocol("plcopen", tmp_path / "missing") == 2


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("dbc", "{}/none"), "hri_predict.dbc: cannot be written: No such file"),
        (("dbc", "{}", "--base-id", "x"), "--base-id x: not a whole number"),
        (("dbc", "{}", "--base-id", "0x7ff"), "base_id"),
        (("document", "{}/none.md"), "none.md: cannot be read: No such file"),
        (("c-header", "{}"), "hri_predict.h: cannot be read: No such file"),
    ],
)
def test_mistakes_give_one_line(tmp_path, capsys, arguments, says):
    assert protocol(*(word.format(tmp_path) for word in arguments)) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert says in line
    assert list(tmp_path.iterdir()) == []


def test_what_never_ends_is_not_read(capsys):
    assert protocol("document", "/dev/full") == 2
    assert "not a file" in capsys.readouterr().err
