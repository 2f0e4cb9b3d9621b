"""CHANGELOG, CONTRIBUTING, upgrade notes and decisions name only what is there."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CONTRIBUTING = ROOT / "CONTRIBUTING.md"
CHANGELOG = ROOT / "CHANGELOG.md"
UPGRADE = ROOT / "docs" / "guides" / "upgrade.md"
DECISIONS = sorted((ROOT / "docs" / "decisions").glob("*.md"))
HEADINGS = ["Context", "Decision", "Why", "What it costs", "When to revisit"]
MAX_COLUMNS = 82
"""Of a fenced block: as many as a page of the site shows without scrolling."""


def drawing():
    """The way of a frame, as text."""
    found = re.search(
        r"## The way of a frame\n.*?```text\n(.*?)```", CONTRIBUTING.read_text(), re.S
    )
    assert found is not None
    return found[1]


def moved():
    """(before, now) of every module in the table of the page on upgrades."""
    table = UPGRADE.read_text(encoding="utf-8").split("moved without an alias")[1]
    rows = re.findall(r"\| `(hri_[\w.]+)`[^|]*\| `(hri_[\w.]+)` \|", table)
    assert len(rows) > 50
    return rows


def test_every_module_that_moved_is_where_the_upgrade_page_says():
    assert [now for _, now in moved() if find_spec(now) is None] == []


def test_every_module_that_moved_is_gone_from_where_it_was():
    def still_a_module(name):
        path = (ROOT / Path(*name.split("."))).with_suffix(".py")
        bases = (ROOT, ROOT / "drivers", ROOT / "sim")
        return any((base / path.relative_to(ROOT)).exists() for base in bases)

    assert [before for before, _ in moved() if still_a_module(before)] == []


@pytest.mark.parametrize(
    "page", [CONTRIBUTING, CHANGELOG, UPGRADE, *DECISIONS], ids=lambda p: p.name
)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target


def test_contributing_names_only_files_that_are_there_each_with_its_folder():
    named = re.findall(r"`([\w./]+\.(?:py|md|yaml|toml|st|h|c))`", CONTRIBUTING.read_text("utf-8"))
    assert len(named) > 30
    there = [name for name in named if "NAME" not in name]
    assert [name for name in there if not (ROOT / name).exists()] == []


def test_the_way_of_a_frame_names_only_files_that_are_there():
    named = re.findall(r"[\w/]+\.\w+", drawing())
    assert len(named) > 15
    assert [
        n for n in named if not any((ROOT / b / n).exists() for b in (".", "hri_predict"))
    ] == []


def test_the_way_of_a_frame_fits_a_page():
    assert max(map(len, drawing().splitlines())) <= MAX_COLUMNS


def test_every_reason_that_the_safety_page_names_is_given_by_the_code():
    text = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
    reasons = set(re.findall(r"`([A-Z]+(?:_[A-Z]+)+)`", text))
    rooms = [p for p in (ROOT / "hri_predict").rglob("*.py") if p.name != "reasons.py"]
    code = "".join(p.read_text(encoding="utf-8") for p in rooms)
    assert len(reasons) > 10
    assert [reason for reason in sorted(reasons) if f"Reason.{reason}" not in code] == []


def test_links_of_the_safety_page_lead_somewhere():
    page = ROOT / "docs" / "safety.md"
    targets = re.findall(r"\]\((?!http)([^)#]+)", page.read_text(encoding="utf-8"))
    assert [target for target in targets if not (page.parent / target).exists()] == []


def test_contributing_names_every_room():
    rooms = [p.name for p in (ROOT / "hri_predict").iterdir() if (p / "__init__.py").exists()]
    text = CONTRIBUTING.read_text(encoding="utf-8")
    assert [room for room in rooms if f"`{room}/`" not in text] == []


@pytest.mark.parametrize("page", DECISIONS, ids=lambda p: p.name)
def test_a_decision_says_what_a_successor_asks(page):
    text = page.read_text(encoding="utf-8")
    if page.name == "README.md":
        listed = {f"{name}.md" for name in re.findall(r"\]\(([\w-]+)\.md\)", text)}
        assert listed == {p.name for p in DECISIONS} - {"README.md"}
    elif page.name != "protocol-versions.md":
        assert re.findall(r"^## (.*)", text, re.MULTILINE) == HEADINGS
        assert 20 <= text.count("\n") <= 40
