"""Runs our IEC 61131-3 structured text, by turning it into Python.

It is stricter than any vendor's compiler, so that what passes here means the same in all of them:
no type becomes another without a conversion in words, bits and numbers do not mix, functions are
called with all their inputs by name, only UDINT may overflow (ticks and counts wrap), a conversion
must not lose anything, and an index must be in its range. What it does not know is an error.
"""

import re
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

BITS = {"BOOL": 1, "BYTE": 8, "WORD": 16, "DWORD": 32}
UNSIGNED = {"USINT": 8, "UINT": 16, "UDINT": 32}
SIGNED = {"INT": 16, "DINT": 32}
ELEMENTARY = {**BITS, **UNSIGNED, **SIGNED}
LITERAL = "a literal"
_TOKEN = re.compile(r"\s*(16#[0-9A-F]+|\d+(?!\w)|[A-Za-z]\w*|:=|<>|<=|>=|\.\.|[-+*/=<>()\[\],;:.])")
_LEVELS: tuple[tuple[str, ...], ...] = (  # operators, the loosest first
    ("OR",),
    ("XOR",),
    ("AND",),
    ("=", "<>"),
    ("<", ">", "<=", ">="),
    ("+", "-"),
    ("*", "/", "MOD"),
)
_SIGN = {"OR": "|", "XOR": "^", "AND": "&", "=": "==", "<>": "!="}


def limits(kind: str) -> tuple[int, int]:
    """Smallest and largest value of an elementary type."""
    bits = ELEMENTARY[kind]
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if kind in SIGNED else (0, (1 << bits) - 1)


@dataclass(frozen=True)
class Variable:
    section: str  # VAR_INPUT, VAR_OUTPUT, VAR or VAR CONSTANT
    kind: str  # of its elements, if it is an array
    bounds: tuple[int, int] | None
    initial: int


@dataclass
class Definition:
    name: str
    returns: str | None  # the type of a function
    variables: dict[str, Variable]
    code: Any = None

    def inputs(self) -> list[str]:
        return [name for name, v in self.variables.items() if v.section == "VAR_INPUT"]


@dataclass
class Unit:
    """A function, or an instance of a function block, which keeps its variables between calls."""

    definition: Definition
    known: dict[str, Definition]
    variables: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, v in self.definition.variables.items():
            if v.kind not in ELEMENTARY:
                self.variables[name] = Unit(self.known[v.kind], self.known)
            else:
                count = v.bounds[1] - v.bounds[0] + 1 if v.bounds else 0
                self.variables[name] = [v.initial] * count if v.bounds else v.initial

    def another(self) -> "Unit":
        return Unit(self.definition, self.known)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        d = self.definition
        if d.returns is not None:
            self.variables.clear()
            self.__post_init__()
        for name, value in (*zip(d.inputs(), arguments, strict=False), *named.items()):
            v = d.variables[name]
            assert v.section == "VAR_INPUT", name
            for number in value if v.bounds else (value,):
                _check(int(number), v.kind, name)
            assert not v.bounds or len(value) == len(self.variables[name]), name
            self.variables[name] = deepcopy(value) if v.bounds else int(value)
        exec(d.code, {"v": self.variables, "run": self._run, **_RUNTIME})
        return self.variables.get(d.name)

    def _run(self, name: str, **named: Any) -> Any:
        return Unit(self.known[name], self.known)(**named)


def _check(value: int, kind: str, what: str) -> int:
    low, high = limits(kind)
    if not low <= value <= high:
        raise OverflowError(f"{what}: {value} is no {kind}")
    return value


def _arithmetic(sign: str, a: int, b: int, kind: str) -> int:
    if sign in ("/", "MOD"):
        quotient = abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)
        return quotient if sign == "/" else a - b * quotient
    value = a + b if sign == "+" else a - b if sign == "-" else a * b
    return value & 0xFFFFFFFF if kind == "UDINT" and sign != "*" else _check(value, kind, sign)


def _at(index: int, low: int, high: int, name: str) -> int:
    if not low <= index <= high:
        raise IndexError(f"{name}[{index}]")
    return index - low


_RUNTIME = {"check": _check, "arithmetic": _arithmetic, "at": _at}


def load(*texts: str) -> dict[str, Unit]:
    """All functions and function blocks of some sources; what one uses stands before it."""
    known: dict[str, Definition] = {}
    for text in texts:
        tokens = list(_tokens(re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL)))
        while tokens:
            definition = _Reader(tokens, known).unit()
            known[definition.name] = definition
    return {name: Unit(definition, known) for name, definition in known.items()}


def _tokens(text: str) -> Iterator[str]:
    place, text = 0, text.rstrip()
    while place < len(text):
        match = _TOKEN.match(text, place)
        assert match, f"not understood: {text[place : place + 40]!r}"
        place = match.end()
        yield match[1]


class _Reader:
    """Reads one unit from the front of ``tokens``; expressions are (Python, type)."""

    def __init__(self, tokens: list[str], known: dict[str, Definition]) -> None:
        self.tokens, self.known = tokens, known
        self.lines: list[str] = []
        self.loops = 0

    def take(self, *expected: str) -> str:
        token = self.tokens.pop(0)
        assert not expected or token in expected, f"{token} instead of {expected}"
        return token

    def taken(self, token: str) -> bool:
        return self.tokens[0] == token and bool(self.take())

    def unit(self) -> Definition:
        word = self.take("FUNCTION", "FUNCTION_BLOCK")
        d = self.definition = Definition(self.take(), None, {})
        if word == "FUNCTION":
            self.take(":")
            d.returns = self.take()
            d.variables[d.name] = Variable("VAR_OUTPUT", d.returns, None, 0)
        while self.tokens[0].startswith("VAR"):
            section = self.take()
            section += " CONSTANT" if self.taken("CONSTANT") else ""
            while not self.taken("END_VAR"):
                name, variable = self.declaration(section)
                assert name not in d.variables, name
                d.variables[name] = variable
        self.block(0, "END_" + word)
        d.code = compile("\n".join(self.lines) or "pass", d.name, "exec")
        return d

    def declaration(self, section: str) -> tuple[str, Variable]:
        name, bounds, initial = self.take(), None, 0
        self.take(":")
        if self.taken("ARRAY"):
            self.take("[")
            low = int(self.take())
            self.take("..")
            bounds = (low, int(self.take()))
            self.take("]")
            self.take("OF")
        kind = self.take()
        assert kind in ELEMENTARY or (kind in self.known and not self.known[kind].returns), kind
        if self.taken(":="):
            literal = self.take()
            initial = {"TRUE": 1, "FALSE": 0}.get(literal) or _number(literal)
            _check(initial, kind, name)
        self.take(";")
        return name, Variable(section, kind, bounds, initial)

    def block(self, depth: int, *ends: str) -> str:
        """Statements up to one of ``ends``, which is taken."""
        start = len(self.lines)
        while self.tokens[0] not in ends:
            self.statement(depth)
        if len(self.lines) == start:
            self.lines.append("    " * depth + "pass")
        return self.take()

    def statement(self, depth: int) -> None:
        margin = "    " * depth
        if self.taken("IF"):
            word = "if"
            while word != "END_IF":
                condition = "" if word == "else" else f" {self.of('BOOL')}"
                if word != "else":
                    self.take("THEN")
                self.lines.append(f"{margin}{word}{condition}:")
                word = self.block(depth + 1, "ELSIF", "ELSE", "END_IF")
                word = {"ELSIF": "elif", "ELSE": "else"}.get(word, word)
            self.take(";")
        elif self.taken("FOR"):
            name = self.take()
            kind = self.variable(name).kind
            self.take(":=")
            first = self.of(kind)
            self.take("TO")
            last = self.of(kind)
            self.take("DO")
            self.loops += 1
            turn = f"turn{self.loops}"
            self.lines.append(f"{margin}for {turn} in range({first}, {last} + 1):")
            self.lines.append(f"{margin}    v[{name!r}] = {turn}")
            self.block(depth + 1, "END_FOR")
            self.take(";")
        else:
            self.lines.append(margin + self.simple())
            self.take(";")

    def simple(self) -> str:
        """An assignment, or the call of a function block."""
        name = self.take()
        variable = self.variable(name)
        if variable.kind in self.known:
            return f"v[{name!r}]({self.arguments(self.known[variable.kind])})"
        writable = ("VAR_OUTPUT", "VAR")
        assert variable.section in writable, f"{name} is not to be written"
        if variable.bounds and self.tokens[0] != "[":
            self.take(":=")
            return f"v[{name!r}] = list({self.array(variable)})"
        target = f"v[{name!r}]{self.index(name, variable)}"
        self.take(":=")
        return f"{target} = check({self.of(variable.kind)}, {variable.kind!r}, {name!r})"

    def variable(self, name: str) -> Variable:
        assert name in self.definition.variables, f"{self.definition.name}: no variable {name}"
        return self.definition.variables[name]

    def index(self, name: str, variable: Variable) -> str:
        if not variable.bounds:
            return ""
        self.take("[")
        index, kind = self.expression()
        assert kind == LITERAL or kind in UNSIGNED or kind in SIGNED, f"{name}[{kind}]"
        self.take("]")
        return f"[at({index}, {variable.bounds[0]}, {variable.bounds[1]}, {name!r})]"

    def of(self, kind: str) -> str:
        """An expression of this type."""
        python, found = self.expression()
        return self.fitting(python, found, kind)

    def fitting(self, python: str, found: str, kind: str) -> str:
        if found == LITERAL and kind != "BOOL":
            _check(eval(python), kind, python)
            return python
        assert found == kind, f"{self.definition.name}: {python} is {found}, not {kind}"
        return python

    def arguments(self, callee: Definition) -> str:
        """Of a call, all by name, in parentheses."""
        self.take("(")
        given: dict[str, str] = {}
        while not given or self.take(",", ")") == ",":
            name = self.take()
            self.take(":=")
            wanted = callee.variables[name]
            if wanted.bounds:
                given[name] = self.array(wanted)
            else:
                given[name] = self.of(wanted.kind)
        assert set(given) <= set(callee.inputs()), f"{callee.name}: {sorted(given)}"
        if callee.returns:
            assert set(given) == set(callee.inputs()), f"{callee.name}: {sorted(given)}"
        return ", ".join(f"{name}={value}" for name, value in given.items())

    def array(self, wanted: Variable) -> str:
        """A whole array, or an output that is one."""
        name = self.take()
        actual, python = self.variable(name), f"v[{name!r}]"
        if self.taken("."):
            member = self.take()
            actual = self.known[actual.kind].variables[member]
            assert actual.section == "VAR_OUTPUT", member
            python += f".variables[{member!r}]"
        assert (actual.bounds, actual.kind) == (wanted.bounds, wanted.kind), name
        return python

    def expression(self, level: int = 0) -> tuple[str, str]:
        if level == len(_LEVELS):
            return self.primary()
        left, kind = self.expression(level + 1)
        while self.tokens[0] in _LEVELS[level]:
            sign = self.take()
            right, other = self.expression(level + 1)
            both = other if kind == LITERAL else kind
            if both != LITERAL:
                left, right = self.fitting(left, kind, both), self.fitting(right, other, both)
            left, kind = self.combined(sign, left, right, both)
        return left, kind

    def combined(self, sign: str, left: str, right: str, kind: str) -> tuple[str, str]:
        numeric = kind in UNSIGNED or kind in SIGNED or kind == LITERAL
        if sign in ("OR", "XOR", "AND"):
            assert kind in BITS, f"{left} {sign} {right} of {kind}"
            return f"({left} {_SIGN[sign]} {right})", kind
        if sign in ("=", "<>", "<", ">", "<=", ">="):
            assert numeric or sign in _SIGN, f"{left} {sign} {right} of {kind}"
            return f"int({left} {_SIGN.get(sign, sign)} {right})", "BOOL"
        assert numeric, f"{left} {sign} {right} of {kind}"
        assert kind != LITERAL, f"write the result of {left} {sign} {right}"
        return f"arithmetic({sign!r}, {left}, {right}, {kind!r})", kind

    def primary(self) -> tuple[str, str]:
        token: str = self.take()
        if token == "NOT":
            python, kind = self.primary()
            return f"({python} ^ {limits(kind)[1]})", self.of_bits(kind)
        if token == "(":
            inside = self.expression()
            self.take(")")
            return inside
        if token == "-":
            return f"-{_number(self.take())}", LITERAL
        if token in ("TRUE", "FALSE"):
            return str(int(token == "TRUE")), "BOOL"
        if token[0].isdigit():
            return str(_number(token)), LITERAL
        if self.tokens[0] == "(":
            return self.call(token)
        variable = self.variable(token)
        if self.taken("."):
            member = self.take()
            inner = self.known[variable.kind].variables[member]
            assert (inner.section, inner.bounds) == ("VAR_OUTPUT", None), member
            return f"v[{token!r}].variables[{member!r}]", inner.kind
        assert variable.kind in ELEMENTARY, token
        return f"v[{token!r}]{self.index(token, variable)}", variable.kind

    def of_bits(self, kind: str) -> str:
        assert kind in BITS, f"NOT of {kind}"
        return kind

    def call(self, name: str) -> tuple[str, str]:
        if "_TO_" in name:
            source, target = name.split("_TO_")
            self.take("(")
            python = self.of(source)
            self.take(")")
            return f"check({python}, {target!r}, {name!r})", target
        callee = self.known[name]
        assert callee.returns, f"{name} is a type"
        return f"run({name!r}, {self.arguments(callee)})", callee.returns


def _number(text: str) -> int:
    return int(text[3:], 16) if text.startswith("16#") else int(text)


Units = dict[str, Unit]
Loader = Callable[..., Units]
