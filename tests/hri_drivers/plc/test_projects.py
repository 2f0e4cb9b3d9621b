"""What engineering tools import: PLCopen XML and SCL, the same code as the structured text."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from hri_predict.protocol.generate import plcopen, structured_text
from tests.hri_drivers.plc.conftest import PLC, SOURCES, everything
from tests.hri_drivers.plc.reserved_words import RESERVED
from tests.hri_drivers.plc.structured_text import Units, load

TC6, XHTML = f"{{{plcopen.NAMESPACE}}}", f"{{{plcopen.XHTML}}}"
PROJECT = PLC / "hri_predict.xml"

# What PLCopen's schema demands of the elements that we write: their attributes, and their children
# in order; "?" may be missing, "*" comes any number of times.
SCHEMA: dict[str, tuple[set[str], str]] = {
    "project": (set(), "fileHeader contentHeader types instances"),
    "fileHeader": ({"companyName", "productName", "productVersion", "creationDateTime"}, ""),
    "contentHeader": ({"name"}, "coordinateInfo"),
    "coordinateInfo": (set(), "fbd ld sfc"),
    **dict.fromkeys(("fbd", "ld", "sfc"), (set(), "scaling")),
    "scaling": ({"x", "y"}, ""),
    "types": (set(), "dataTypes pous"),
    "dataTypes": (set(), ""),
    "pous": (set(), "pou*"),
    "pou": ({"name", "pouType"}, "interface body documentation?"),
    "interface": (set(), "returnType? inputVars? outputVars? localVars*"),
    **dict.fromkeys(("inputVars", "outputVars", "localVars"), (set(), "variable*")),
    "variable": ({"name"}, "type initialValue? documentation?"),
    "array": (set(), "dimension baseType"),
    "dimension": ({"lower", "upper"}, ""),
    "derived": ({"name"}, ""),
    "initialValue": (set(), "simpleValue"),
    "simpleValue": ({"value"}, ""),
    "body": (set(), "ST"),
    "instances": (set(), "configurations"),
    "configurations": (set(), ""),
    **dict.fromkeys(plcopen.ELEMENTARY, (set(), "")),
}
TYPES = {*plcopen.ELEMENTARY, "array", "derived"}


def same(units: Units) -> None:
    """They are what the structured text defines: names, types, values and statements."""
    want = everything()
    assert list(units) == list(want)
    for name, unit in want.items():
        assert units[name].definition.variables == unit.definition.variables, name
        assert units[name].definition.code == unit.definition.code, name


def test_the_sources_are_those_that_the_command_reads() -> None:
    assert [path.name for path in SOURCES] == list(structured_text.FILES)
    assert {path.name for path in PLC.glob("*.st")} == set(structured_text.FILES)


def check(element: ElementTree.Element) -> None:
    tag = element.tag.removeprefix(TC6)
    if tag in ("documentation", "ST"):
        (inside,) = element
        assert inside.tag == f"{XHTML}xhtml"
        assert inside.text
        return
    children = [child.tag.removeprefix(TC6) for child in element]
    if tag in ("type", "baseType", "returnType"):
        assert len(children) == 1
        assert children[0] in TYPES
    else:
        attributes, order = SCHEMA[tag]
        more = {"constant"} if tag == "localVars" else set()
        assert attributes <= set(element.attrib) <= attributes | more, tag
        pattern = "".join(re.sub(r"(\w+)(\W?)", r"(?:\1 )\2", word) for word in order.split())
        assert re.fullmatch(pattern, "".join(f"{child} " for child in children)), (tag, children)
    for child in element:
        check(child)


def test_the_project_has_the_structure_of_plcopen() -> None:
    root = ElementTree.parse(PROJECT).getroot()
    assert root.tag == f"{TC6}project"
    check(root)
    kinds = {pou.get("pouType") for pou in root.iter(f"{TC6}pou")}
    assert kinds == {"function", "functionBlock"}


def declaration(variable: ElementTree.Element) -> str:
    kind = variable.find(f"{TC6}type")[0]  # type: ignore[index]
    dimension = kind.find(f"{TC6}dimension")
    if dimension is not None:
        inner = kind.find(f"{TC6}baseType")[0]  # type: ignore[index]
        text = f"ARRAY[{dimension.get('lower')}..{dimension.get('upper')}] OF "
        text += inner.tag.removeprefix(TC6)
    else:
        text = kind.get("name") or kind.tag.removeprefix(TC6)
    value = variable.find(f"{TC6}initialValue/{TC6}simpleValue")
    return f"{variable.get('name')} : {text}" + (
        f" := {value.get('value')};" if value is not None else ";"
    )


def test_the_project_is_the_same_code() -> None:
    text = ""
    lists = {"inputVars": "VAR_INPUT", "outputVars": "VAR_OUTPUT", "localVars": "VAR"}
    for pou in ElementTree.parse(PROJECT).getroot().iter(f"{TC6}pou"):
        returned = pou.find(f"{TC6}interface/{TC6}returnType")
        word = "FUNCTION_BLOCK" if returned is None else "FUNCTION"
        text += f"{word} {pou.get('name')}"
        text += "\n" if returned is None else f" : {returned[0].tag.removeprefix(TC6)}\n"
        for section in pou.find(f"{TC6}interface") or ():
            name = lists.get(section.tag.removeprefix(TC6))
            if name:
                text += name + (" CONSTANT" if section.get("constant") == "true" else "") + "\n"
                text += "\n".join(map(declaration, section)) + "\nEND_VAR\n"
        text += f"{pou.findtext(f'{TC6}body/{TC6}ST/{XHTML}xhtml')}\nEND_{word}\n"
    same(load(text))


def test_the_scl_is_the_same_code() -> None:
    text = (PLC / "hri_predict.scl").read_text(encoding="utf-8")
    local = re.findall(r"(?<!16)#(\w+)", text)
    assert set(local) & {"BYTE_TO_UINT", "TRUE", "IF"} == set()
    text = re.sub(r"(?<!16)#", "", text.replace('"', "").replace("VAR_TEMP", "VAR"))
    text = re.sub(r"^(\{.*\}|VERSION : 0\.1|BEGIN)\n", "", text, flags=re.MULTILINE)
    units = load(text)
    want = everything()
    assert list(units) == list(want)
    for name, unit in want.items():  # sections stand in another order
        assert units[name].definition.code == unit.definition.code, name
        assert dict(units[name].definition.variables) == dict(unit.definition.variables), name


def test_no_name_is_a_word_of_the_languages_or_of_another_name() -> None:
    for name, unit in everything().items():
        names = [v.upper() for v in unit.definition.variables if v != name]
        assert set(names) & RESERVED == set(), name
        assert len(set(names)) == len(names), f"{name}: two names differ by case only"
        assert set(names) & {other.upper() for other in everything()} == set(), name
        assert not [v for v in names if re.fullmatch(r"[IQMPAE][BWDX]?\d+|.*__.*|_.*|.*_", v)]
        assert name.startswith("HRI_")


@pytest.mark.long
def test_a_grammar_of_twincat_reads_it(tmp_path: Path) -> None:
    source = tmp_path / "all.st"
    source.write_text("\n".join(path.read_text(encoding="ascii") for path in SOURCES))
    blark = Path(sys.executable).with_name("blark")
    program = str(blark) if blark.exists() else shutil.which("blark")
    if program is None:
        pytest.skip("no blark here: pip install blark")
    done = subprocess.run([program, "parse", source], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


@pytest.mark.parametrize(
    "wrong",
    [
        "Small := Large;",
        "Large := Small;",
        "Bits := Small;",
        "Large := Bits AND 16#01;",
        "Small := 256;",
        "Flag := Small;",
        "Small := Missing;",
        "In1 := 3;",
        "IF Small THEN Flag := TRUE; END_IF;",
        "Small := USINT_TO_UINT(Small);",
        "Small := HALF(3);",
        "WHILE Flag DO Small := 1; END_WHILE;",
    ],
)
def test_the_reader_refuses_what_a_compiler_would(wrong: str) -> None:
    half = "FUNCTION HALF : USINT\nVAR_INPUT\nX : USINT;\nEND_VAR\nHALF := X / 2;\nEND_FUNCTION\n"
    begin = (
        "FUNCTION_BLOCK T1\nVAR_INPUT\nIn1 : UINT;\nEND_VAR\nVAR\nSmall : USINT;\nLarge : UINT;\n"
    )
    begin += "Bits : BYTE;\nFlag : BOOL;\nEND_VAR\n"
    load(f"{half}{begin}Small := HALF(X := 3);\nEND_FUNCTION_BLOCK")
    with pytest.raises((AssertionError, OverflowError)):
        load(f"{half}{begin}{wrong}\nEND_FUNCTION_BLOCK")


@pytest.mark.parametrize("body", ["S := S + 200;", "A[S] := 1;", "S := UINT_TO_USINT(U + 256);"])
def test_the_reader_traps_what_would_overflow(body: str) -> None:
    unit = load(
        "FUNCTION_BLOCK T1\nVAR\nS : USINT := 100;\nU : UINT;\nA : ARRAY[0..9] OF UINT;\nEND_VAR\n"
        f"{body}\nEND_FUNCTION_BLOCK"
    )["T1"]
    with pytest.raises((OverflowError, IndexError)):
        unit()
