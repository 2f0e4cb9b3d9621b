"""The page of all keys is what the code says now, and leaves none out."""

import re
from pathlib import Path

import pytest

from hri_predict.cli.generate.config import DOCUMENT
from hri_predict.cli.settings_page.page import page
from hri_predict.cli.settings_page.schema import schema

ROOT = Path(__file__).resolve().parents[4]


@pytest.fixture(scope="module")
def text():
    return page()


def test_the_page_is_up_to_date(text):
    there = (ROOT / DOCUMENT).read_text(encoding="utf-8")
    assert there == text, "run: hri-predict config document"


def test_every_key_stands_on_the_page(text):
    rows = re.findall(r"^\| `(?:[^`]*\.)?([a-z_0-9]+)` \|", text, re.M)
    whole = schema(ours_only=True)
    keys = set(whole["properties"])
    for block in whole["$defs"].values():
        for member in (block, *block.get("anyOf", [])):
            keys |= set(member.get("properties", {}))
    assert len(keys) > 250
    assert keys <= set(rows)


def test_every_row_has_five_cells_and_a_description(text):
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert len(rows) > 350
    for row in rows:
        cells = re.split(r"(?<!\\)\|", row)
        assert len(cells) == 7
        assert cells[5].strip(), row


def test_every_link_leads_to_a_heading(text):
    headings = re.findall(r"^## (.+)$", text, re.M)
    anchors = [re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings]
    assert len(anchors) == len(set(anchors))
    links = re.findall(r"\]\(#([^)]+)\)", text)
    assert len(links) > 100
    assert set(links) <= set(anchors)


@pytest.mark.parametrize(
    "row",
    [
        "| `rate_hz` | number, 10 to 100 | `25` | Hz | cycles per second; controllers expect at"
        " least 10 |",
        "| `robots[].max_speed_m_s` | number, 0.01 to 20 | **required** | m/s | maximum"
        " speed of the fastest point in production |",
    ],
)
def test_a_row_gives_path_type_default_unit_and_meaning(text, row):
    assert row in text.splitlines()
