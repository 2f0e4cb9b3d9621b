"""Habits that make a native reader stop, counted: ``python -m tests.english`` lists each place.

``python -m tests.english ROOM`` lists those of one room, ``--write`` lowers ``english.txt``, the
table of counts beside this file. ``tests/test_english.py`` fails when a count differs from it.
Docstrings and all other strings of two words and more (errors, descriptions, help texts, messages)
are read, comments are not. README and guides are rooms, too.
"""

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.house import MODULES, ROOT, room_of

TABLE = Path(__file__).with_suffix(".txt")

_THINGS = r"(?:it|them|this|that|one|each|(?:\w+ ){0,2}(?:robots?|machines?|people|person|file))"

HABITS = {
    "so many": r"\bso (?:far (?:apart|back|from)|(?:many|much|long|few|often)(?! (?:that|as)\b))\b",
    "whoever": r"\b(?:whoever|whom|whatever(?! (?:the|its|their)\b))\b",
    "is no": r"(?<!there )\b(?:is|are|was|were|be) no (?!longer|more|less|other|\w+er than)",
    "somebody": r"\b(?:some|any|no|every)body\b",
    "told": r"\b(?:told|tells?|telling)\b(?! (?:\w+ ){0,4}apart)",
    "beside": rf"\bbeside\b(?! {_THINGS}\b)",
    "odd": r"\b(?:anew|in the place of|(?:is|are) of now|the most that there can be)\b",
}
"""Name -> pattern of what is avoided in every text."""

OPENING = "What ..."
"""Name of the habit to open a docstring with a question or *of*, not with a noun or a verb."""

_PATTERNS = {name: re.compile(pattern, re.IGNORECASE) for name, pattern in HABITS.items()}
_OPENS = re.compile(r"(?:What|Where|Who|Whose|How|Of|By how|For how)\b")
_CODE = re.compile(r"``.*?``|`[^`]*`")
_FENCED = re.compile(r"^( *)```.*?^\1```", re.MULTILINE | re.DOTALL)

Counts = dict[tuple[str, str], int]
"""(room, habit) -> number of places; a pair without any is left out."""


@dataclass(frozen=True)
class Text:
    """A docstring, another string, or a paragraph of a page.

    Attributes:
        line: the line on which it begins, from 1.
        text: its words, with single spaces.
        is_docstring: of a module, class, function or attribute.
    """

    line: int
    text: str
    is_docstring: bool = False

    def habits(self) -> Iterator[tuple[str, str]]:
        """Yield each habit found in the text, and the words around it."""
        text = _CODE.sub("``", self.text)
        if self.is_docstring and _OPENS.match(text):
            yield OPENING, text[:80]
        for name, pattern in _PATTERNS.items():
            for found in pattern.finditer(text):
                yield name, text[max(found.start() - 40, 0) : found.end() + 40]


def texts_of(source: str) -> Iterator[Text]:
    """Yield the docstrings and strings of two words and more in a module's source."""
    nodes = list(ast.walk(ast.parse(source)))
    docstrings = {
        id(node.value)
        for node in nodes
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    parts = {id(value) for n in nodes if isinstance(n, ast.JoinedStr) for value in n.values}
    for node in (n for n in nodes if isinstance(n, ast.JoinedStr | ast.Constant)):
        if isinstance(node, ast.JoinedStr):
            text = " ".join(_constant(value) for value in node.values)
        elif id(node) in parts:
            continue
        else:
            text = _constant(node)
        words = text.split()
        if len(words) > 1:
            yield Text(node.lineno, " ".join(words), id(node) in docstrings)


def paragraphs(page: str) -> Iterator[Text]:
    """Yield the paragraphs of a Markdown page, without its blocks of code."""
    page = _FENCED.sub(lambda block: "\n" * block[0].count("\n"), page)
    for number, line in enumerate(page.splitlines(), start=1):
        if line.strip():
            yield Text(number, " ".join(line.split()))


def _constant(node: ast.AST) -> str:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def sources() -> Iterator[tuple[str, Path, Iterable[Text]]]:
    """Yield (room, file, texts) of each module, README and guide."""
    for module, path in MODULES.items():
        yield room_of(module), path, texts_of(path.read_text(encoding="utf-8"))
    for path in [ROOT / "README.md", *sorted((ROOT / "docs" / "guides").glob("*.md"))]:
        room = "README" if path.name == "README.md" else "guides"
        yield room, path, paragraphs(path.read_text(encoding="utf-8"))


def counts() -> Counts:
    """Return the number of places today."""
    return Counter(
        (room, habit)
        for room, _, texts in sources()
        for text in texts
        for habit, _ in text.habits()
    )


def read_table() -> Counts:
    """Return the numbers of the table."""
    rows = [line.rsplit(maxsplit=1) for line in TABLE.read_text(encoding="utf-8").splitlines()]
    return {(pair.split(maxsplit=1)[0], pair.split(maxsplit=1)[1]): int(n) for pair, n in rows}


def differences(now: Counts, table: Counts) -> list[str]:
    """Return one line for each count that differs from the table."""
    return [
        f"{room}: '{habit}' {table.get((room, habit), 0)} -> {now.get((room, habit), 0)}"
        for room, habit in sorted(now.keys() | table.keys())
        if now.get((room, habit), 0) != table.get((room, habit), 0)
    ]


def _write(now: Counts) -> None:
    rows = [f"{room:<24} {habit:<10} {n}\n" for (room, habit), n in sorted(now.items())]
    TABLE.write_text("".join(rows), encoding="utf-8")


def main(arguments: list[str]) -> int:
    """List the places of all rooms or of those named, or write the table; return the status."""
    if arguments == ["--write"]:
        now, table = counts(), read_table()
        risen = [pair for pair in now if now[pair] > table.get(pair, 0)]
        if risen:
            print("\n".join(["the table is only lowered:", *differences(now, table)]))
            return 1
        _write(now)
        print(f"{sum(now.values())} places")
        return 0
    for room, path, texts in sources():
        if not arguments or room in arguments:
            for text in texts:
                for habit, words in text.habits():
                    print(f"{path.relative_to(ROOT)}:{text.line}: [{habit}] {words}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
