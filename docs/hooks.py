"""What MkDocs does not do by itself: pages and files from outside of ``docs/`` join the site.

A page of the repository keeps its place: ``drivers/PROTOCOL.md`` becomes ``drivers/PROTOCOL/``, the
README becomes the first page. Links in the pages are those of the repository, so that they work
where the files are read as files; here they are turned into those of the site.
"""

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
FIRST_PAGE = "README.md"
DRAWING = "<!-- the way of a frame -->"
"""Stands in the first page for the drawing at the top of CONTRIBUTING.md."""
PAGES = (
    FIRST_PAGE,
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    *(str(path.relative_to(ROOT)) for path in sorted((ROOT / "drivers").rglob("*.md"))),
    *(str(path.relative_to(ROOT)) for path in sorted((ROOT / "hri_predict").rglob("*.md"))),
)
"""Every page from outside of ``docs/``, as the repository names it."""
_LINK = re.compile(r"(?<=\]\()(?!\w+:|#)([^)#\s]+)(#[^)\s]*)?(?=\))")
_FENCE = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the pages of folders whose files come and go to the navigation."""
    decisions = sorted((ROOT / "docs" / "decisions").glob("*.md"))
    if decisions and config.nav is not None:
        config.nav.append({"Decisions": [f"decisions/{path.name}" for path in decisions]})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages from outside of ``docs/``, and every file that a page links to."""
    pages = [*PAGES, *(f"docs/{file.src_uri}" for file in files.documentation_pages())]
    linked = {target for page in pages for target in _targets(page)}
    for name in dict.fromkeys((*PAGES, *sorted(linked))):
        if not name.startswith("docs/") and (ROOT / name).is_file():
            path = str(ROOT / name)
            files.append(File.generated(config, _on_site(name), abs_src_path=path))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn the repository's links into the site's; a link to a folder becomes its bare text."""
    name = _in_repository(page.file.src_uri)
    markdown = markdown.replace(DRAWING, _drawing())

    def link(match: re.Match[str]) -> str:
        target = _resolved(name, match[1])
        here = posixpath.dirname(page.file.src_uri)
        return posixpath.relpath(_on_site(target), here or ".") + (match[2] or "")

    def bare(match: re.Match[str]) -> str:
        folder = (ROOT / _resolved(name, match[2])).is_dir()
        return f"`{match[1]}`" if folder else match[0]

    parts = _FENCE.split(markdown)
    for index in range(0, len(parts), 2):  # every other part is a fenced block
        parts[index] = re.sub(r"(?<!!)\[([^\]]+)\]\((?!\w+:|#)([^)#\s]+)\)", bare, parts[index])
        parts[index] = _LINK.sub(link, parts[index])
    return "".join(parts)


def _drawing() -> str:
    """Return the first fenced block of CONTRIBUTING.md: the way of a frame."""
    found = _FENCE.search((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    return found[0] if found else ""


def _targets(page: str) -> set[str]:
    text = _FENCE.sub("", (ROOT / page).read_text(encoding="utf-8"))
    return {_resolved(page, match[1]) for match in _LINK.finditer(text)}


def _resolved(page: str, link: str) -> str:
    return posixpath.normpath(posixpath.join(posixpath.dirname(page), link))


def _on_site(name: str) -> str:
    return "index.md" if name == FIRST_PAGE else name.removeprefix("docs/")


def _in_repository(uri: str) -> str:
    if uri == "index.md":
        return FIRST_PAGE
    return uri if uri in PAGES else f"docs/{uri}"
