"""What the guides show as printed is what the commands print today."""

import re

import pytest

from hri_predict.base.errors import ConfigMistakes
from hri_predict.run import config as configuration
from tests import pages
from tests.pages import ROOT, WIRE_A_CELL
from tests.processes import hri_predict

EXPLAIN = ROOT / "docs" / "guides" / "explain.md"


def shown(page, beginning: str) -> str:
    """The block of text of a page that begins so."""
    (found,) = [
        text
        for text in re.findall(r"```text\n(.*?)```", pages.text(page), re.DOTALL)
        if text.startswith(beginning)
    ]
    return found


def test_the_mistakes_that_wire_a_cell_shows(tmp_path):
    text = pages.cell(WIRE_A_CELL)
    text = text.replace("max_speed_m_s: 1.0", "max_speed_m_s: 300")
    (tmp_path / "cell.yaml").write_text(text.replace("mode: predictive", "mod: predictive"))
    with pytest.raises(ConfigMistakes) as caught:
        configuration.load(tmp_path / "cell.yaml")
    lines = shown(WIRE_A_CELL, "error: cell.yaml").splitlines()
    for line, said in zip(lines, caught.value.lines, strict=True):
        wanted = line.removeprefix("error: ").partition("...")[0]
        assert wanted in said


@pytest.mark.long
def test_the_answer_that_explain_shows(tmp_path):
    hri_predict("demo", "--speed", "max", "--record", "demo.mcap", cwd=tmp_path)
    (command,) = re.findall(r"\$ hri-predict (explain demo\.mcap --at \S+)", pages.text(EXPLAIN))
    said = hri_predict(*command.split(), cwd=tmp_path).stdout
    assert said.startswith(shown(EXPLAIN, "7.1 s arm"))
