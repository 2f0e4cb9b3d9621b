"""Times of day on the pages can be copied into ``explain --at``."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from hri_predict.viewing import operator

NODE = shutil.which("node")
PAGES = Path(operator.__file__).parent


@pytest.mark.skipif(NODE is None, reason="no node")
@pytest.mark.parametrize(
    ("zone", "shown"),
    [("UTC", "00:41:08"), ("America/New_York", "19:41:08, 00:41:08 UTC")],
)
def test_a_time_has_24_hours_and_its_utc(zone, shown):
    script = (PAGES / "common.js").read_text(encoding="utf-8")
    (clock,) = re.findall(r"function clock\(at\) \{.*?\n\}", script, re.DOTALL)
    (times,) = re.findall(r"function times\(ms\) \{.*?\n\}", script, re.DOTALL)
    asked = 'times(Date.parse("2026-11-29T00:41:08Z")).join("")'
    said = subprocess.run(
        [str(NODE), "-e", f"{clock}\n{times}\nconsole.log({asked})"],
        capture_output=True,
        check=True,
        env={"TZ": zone, "LC_ALL": "en_US.UTF-8"},
        text=True,
    ).stdout
    assert said.strip() == shown


@pytest.mark.parametrize("page", sorted(PAGES.glob("*.js")), ids=lambda path: path.name)
def test_no_page_leaves_a_time_to_the_browser_s_language(page):
    assert "toLocaleTime" not in page.read_text(encoding="utf-8")
