"""Structured text as PLCopen XML (TC6, version 2.01), which CODESYS and TwinCAT import.

Source: PLCopen TC6, "XML Formats for IEC 61131-3", version 2.01.
"""

from collections.abc import Iterable, Iterator
from xml.sax.saxutils import escape, quoteattr

from hri_predict.protocol.definition import SCHEMA_VERSION
from hri_predict.protocol.generate.structured_text import Unit, Variable

NAMESPACE = "http://www.plcopen.org/xml/tc6_0201"
XHTML = "http://www.w3.org/1999/xhtml"
ELEMENTARY = {"BOOL", "BYTE", "WORD", "DWORD", "USINT", "UINT", "UDINT", "INT", "DINT"}
_LISTS = {
    "VAR_INPUT": "<inputVars>",
    "VAR_OUTPUT": "<outputVars>",
    "VAR": "<localVars>",
    "VAR CONSTANT": '<localVars constant="true">',
}
# One date for all, as the format demands one: the same sources give the same bytes.
_CREATED = "2026-01-01T00:00:00"
_SCALES = "".join(f'<{kind}><scaling x="1" y="1" /></{kind}>' for kind in ("fbd", "ld", "sfc"))


def xml(units: Iterable[Unit]) -> str:
    """Return a complete project document with all ``units``."""
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f'<project xmlns="{NAMESPACE}">',
        f'<fileHeader companyName="hri-predict" productName="hri-predict" '
        f'productVersion="protocol {SCHEMA_VERSION}" creationDateTime="{_CREATED}" />',
        f'<contentHeader name="hri_predict"><coordinateInfo>{_SCALES}</coordinateInfo>'
        "</contentHeader>",
        "<types>",
        "<dataTypes />",
        "<pous>",
        *(line for unit in units for line in _pou(unit)),
        "</pous>",
        "</types>",
        "<instances><configurations /></instances>",
        "</project>",
    ]
    return "\n".join(lines) + "\n"


def _pou(unit: Unit) -> Iterator[str]:
    kind = "function" if unit.returns else "functionBlock"
    yield f'<pou name="{unit.name}" pouType="{kind}">'
    yield "<interface>"
    if unit.returns:
        yield f"<returnType>{_type(unit.returns)}</returnType>"
    for section, variables in unit.sections.items():
        opening = _LISTS[section]
        yield opening
        yield from map(_variable, variables)
        yield f"</{opening[1:].split()[0].rstrip('>')}>"
    yield "</interface>"
    yield f'<body><ST><xhtml xmlns="{XHTML}">{escape(unit.body)}</xhtml></ST></body>'
    if unit.comment:
        yield _documentation(unit.comment)
    yield "</pou>"


def _variable(variable: Variable) -> str:
    kind = _type(variable.kind)
    if variable.bounds:
        low, high = variable.bounds
        kind = (
            f'<array><dimension lower="{low}" upper="{high}" /><baseType>{kind}</baseType></array>'
        )
    text = f'<variable name="{variable.name}"><type>{kind}</type>'
    if variable.initial:
        value = quoteattr(variable.initial)
        text += f"<initialValue><simpleValue value={value} /></initialValue>"
    if variable.comment:
        text += _documentation(variable.comment)
    return text + "</variable>"


def _type(kind: str) -> str:
    return f"<{kind} />" if kind in ELEMENTARY else f'<derived name="{kind}" />'


def _documentation(text: str) -> str:
    return f'<documentation><xhtml xmlns="{XHTML}">{escape(text)}</xhtml></documentation>'
