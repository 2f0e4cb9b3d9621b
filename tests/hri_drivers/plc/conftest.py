"""Runs what our example uses of IEC 61131-3 structured text, by turning it into Python.

Whatever of the language it does not know is an error, so that the example cannot drift into what is
not run. Names of variables hold as they are; widths are those of the declared types.
"""

import re
from pathlib import Path
from typing import Any

import pytest

SOURCE = Path(__file__).resolve().parents[3] / "drivers" / "plc" / "hri_advice.st"

BITS = {"BOOL": 1, "BYTE": 8, "USINT": 8, "INT": 16, "UINT": 16, "UDINT": 32}
_LEVELS = (  # operators, the loosest first, each with its Python
    {"OR": "|"},
    {"XOR": "^"},
    {"AND": "&"},
    {"=": "==", "<>": "!=", "<": "<", ">": ">", "<=": "<=", ">=": ">="},
    {"+": "+", "-": "-"},
    {"*": "*", "/": "//", "MOD": "%"},
)
_TOKEN = re.compile(r"16#[0-9A-F]+|\d+|\w+|<>|<=|>=|[-+*/=<>()\[\],]")
_DECLARATION = re.compile(r"(\w+) : (?:ARRAY\[0\.\.(\d+)\] OF )?(\w+)(?: := ([^;]+))?;")


class Unit:
    """A function or a function block: its variables keep their values from call to call."""

    def __init__(self, name: str, body: str, functions: dict[str, Any]):
        self.name = name
        self.variables: dict[str, Any] = {}
        self.types: dict[str, str] = {}
        self.inputs: list[str] = []
        while match := re.match(
            r"\s*VAR(_INPUT|_OUTPUT| CONSTANT)?\n(.*?)END_VAR", body, re.DOTALL
        ):
            for variable, last, kind, value in _DECLARATION.findall(match[2]):
                initial = _number(value) if value else 0
                self.types[variable] = kind
                self.variables[variable] = [0] * (int(last) + 1) if last else initial
                if match[1] == "_INPUT":
                    self.inputs.append(variable)
            body = body[match.end() :]
        self._code = compile(_python(body, self), name, "exec")
        self._functions = functions

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        for variable, value in (*zip(self.inputs, arguments, strict=False), *named.items()):
            assert variable in self.inputs, variable
            self.variables[variable] = value
        exec(self._code, {"unit": self, "v": self.variables, **self._functions})
        return self.variables.get(self.name)

    def assign(self, variable: str, index: int | None, value: int) -> None:
        kind = self.types[variable]
        value = int(value) & ((1 << BITS[kind]) - 1)
        if index is None:
            self.variables[variable] = value
        else:
            assert index >= 0
            self.variables[variable][index] = value


@pytest.fixture
def units() -> dict[str, Any]:
    """What the example defines, by name; each can be called."""
    return load(SOURCE.read_text(encoding="ascii"))


def load(text: str) -> dict[str, Any]:
    """All functions and function blocks of a source."""
    text = re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL)
    functions: dict[str, Any] = {  # of bytes
        "SHL": lambda value, count: value << count & 0xFF,
        "SHR": lambda value, count: value >> count,
    }
    for a in BITS:
        functions |= {f"{a}_TO_{b}": (lambda value: value) for b in BITS}
    units: dict[str, Any] = {}
    pattern = r"FUNCTION(?:_BLOCK)? (\w+)(?: : (\w+))?\n(.*?)END_FUNCTION(?:_BLOCK)?"
    for name, kind, body in re.findall(pattern, text, re.DOTALL):
        returns = f"VAR\n{name} : {kind};\nEND_VAR\n" if kind else ""
        units[name] = functions[name] = Unit(name, returns + body, functions)
    return units


def _number(text: str) -> int:
    return int(text[3:], 16) if text.startswith("16#") else int(text)


def _python(body: str, unit: Unit) -> str:
    """Statements as Python source; every line of structured text ends in ; or THEN, DO, ELSE."""
    lines, depth = [], 0
    flat = " ".join(body.split())
    for statement in re.findall(r".*?(?:;|\bTHEN\b|\bDO\b|\bELSE\b)", flat):
        text = statement.strip().rstrip(";").strip()
        if text in ("END_IF", "END_FOR"):
            depth -= 1
        elif text == "ELSE":
            lines.append("    " * (depth - 1) + "else:")
        elif match := re.fullmatch(r"(IF|ELSIF) (.*) THEN", text):
            word, back = ("if", 0) if match[1] == "IF" else ("elif", 1)
            depth -= back
            lines.append("    " * depth + f"{word} {_expression(match[2], unit)}:")
            depth += 1
        elif match := re.fullmatch(r"FOR (\w+) := (\d+) TO (\d+) DO", text):
            lines.append("    " * depth + f"for _ in range({match[2]}, {int(match[3]) + 1}):")
            depth += 1
            lines.append("    " * depth + f"unit.assign({match[1]!r}, None, _)")
        elif match := re.fullmatch(r"(\w+)(?:\[(.*?)\])? := (.*)", text):
            index = _expression(match[2], unit) if match[2] else "None"
            value = _expression(match[3], unit)
            lines.append("    " * depth + f"unit.assign({match[1]!r}, {index}, {value})")
        else:
            raise ValueError(f"{unit.name}: not understood: {text}")
    assert depth == 0, unit.name
    return "\n".join(lines)


def _expression(text: str, unit: Unit) -> str:
    """An expression as Python, in parentheses; truth values are 0 and 1."""
    tokens = _TOKEN.findall(text)
    assert "".join(tokens) == text.replace(" ", ""), f"{unit.name}: not understood: {text}"

    def operators(level: int) -> str:
        if level == len(_LEVELS):
            return primary()
        left = operators(level + 1)
        while tokens and tokens[0] in _LEVELS[level]:
            sign = _LEVELS[level][tokens.pop(0)]
            left = f"({left} {sign} {operators(level + 1)})"
            left = f"({left} & 0xFFFFFFFF)" if sign == "-" else left  # of UDINT: it wraps
        return left

    def until(end: str) -> str:
        inside = [operators(0)]
        while tokens[0] == ",":
            tokens.pop(0)
            inside.append(operators(0))
        assert tokens.pop(0) == end
        return ", ".join(inside)

    def primary() -> str:
        token = tokens.pop(0)
        if token == "NOT":
            return f"(1 ^ {primary()})"
        if token == "(":
            return f"({until(')')})"
        if token in ("TRUE", "FALSE"):
            return str(int(token == "TRUE"))
        if token.startswith("16#") or token.isdigit():
            return str(_number(token))
        if tokens and tokens[0] == "(" and tokens.pop(0):
            return f"{token}({until(')')})"
        assert token in unit.types, f"{unit.name}: no variable {token}"
        if tokens and tokens[0] == "[" and tokens.pop(0):
            return f"v[{token!r}][{until(']')}]"
        return f"v[{token!r}]"

    python = operators(0)
    assert not tokens, f"{unit.name}: not understood: {text}"
    return python
