"""The pages that users read, and what stands in their fenced blocks: one rule for all of them."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES += sorted((ROOT / "drivers").rglob("*.md"))
WIRE_A_CELL = ROOT / "docs" / "guides" / "wire-a-cell.md"
_FENCE = re.compile(r"^( *)```(\w*)[^\n]*\n(.*?)^\1```", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block of a page."""

    page: Path
    language: str
    text: str

    @property
    def file(self) -> str | None:
        """The name that its first line gives it: ``# cell.yaml``."""
        named = re.match(r"# ([\w.]+\.\w+)\n", self.text)
        return named[1] if named else None


def name(page: Path) -> str:
    """A page as the repository names it."""
    return page.relative_to(ROOT).as_posix()


def text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def prose(page: Path) -> str:
    """A page without its fenced blocks."""
    return _FENCE.sub("", text(page))


EXTENDING = ROOT / "docs" / "extending.md"
"""Its blocks are one package, which ``test_extending_doc`` builds, installs and runs."""
BLOCKS = [
    Block(page, language, body)
    for page in PAGES
    if page != EXTENDING
    for _, language, body in _FENCE.findall(text(page))
]


def blocks(language: str, page: Path | None = None) -> list[Block]:
    """The blocks in one language, of one page or of all."""
    return [b for b in BLOCKS if b.language == language and page in (None, b.page)]


def named(file: str, page: Path | None = None) -> Block:
    """The one block of a page (or of all pages) that is this file."""
    (found,) = (b for b in BLOCKS if b.file == file and page in (None, b.page))
    return found


def cell(page: Path) -> str:
    """The ``cell.yaml`` that a page's commands mean: its own, or that of "Wire a cell"."""
    own = any(b.file == "cell.yaml" for b in BLOCKS if b.page == page)
    return named("cell.yaml", page if own else WIRE_A_CELL).text


def commands() -> list[tuple[Path, str]]:
    """Every line ``$ …`` of a console; once, unless its page has a ``cell.yaml`` of its own."""
    found: dict[tuple[str, str], tuple[Path, str]] = {}
    for block in blocks("console"):
        for line in block.text.splitlines():
            command = line.removeprefix("$ ")
            key = (command, cell(block.page) if "cell.yaml" in command else "")
            found.setdefault(key, (block.page, command))
    return list(found.values())
