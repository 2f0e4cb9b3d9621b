"""Ten injected causes, and the answer that a user gets from the recording alone."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hri_predict.cli.commands import app
from tests.hri_predict.explaining.causes import CAUSES, record


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.realtime] if cause.view else [])
        for name, cause in CAUSES.items()
    ],
)
def test_the_first_line_names_the_cause(name: str, tmp_path: Path, near: Path) -> None:
    cause = CAUSES[name]
    path = near if name == "person near" else record(cause, tmp_path / "cell.mcap")
    asked = CliRunner().invoke(app, ["explain", str(path), "--at", str(cause.at_s), "--json"])
    assert asked.exit_code == 0, asked.output
    found = json.loads(asked.stdout)
    for words in cause.says:
        assert words in found["answer"]
    others = {w for other, each in CAUSES.items() if other != name for w in each.marks}
    for words in (others | set(cause.never)) - set(cause.marks):
        assert words not in found["answer"]
