"""Ten injected causes, and the answer that a user gets from the recording alone."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hri_predict.cli.commands import app
from hri_predict.explaining.explanation import explain
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.situation import situation
from hri_predict.explaining.times import AskedTime
from tests.hri_predict.explaining.causes import CAUSES, record
from tests.hri_predict.explaining.made_up import SECOND, told, written


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.realtime] if cause.view else [])
        for name, cause in CAUSES.items()
    ],
)
@pytest.mark.long
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


@pytest.mark.parametrize(("moved_s", "told_s"), [(0.0004, 0.0), (-0.0001, 0.0), (-0.5, -0.5)])
def test_a_clock_that_only_drifts_was_not_set(
    tmp_path: Path, moved_s: float, told_s: float
) -> None:
    clock = (0.3, "/clock", {"utc_moved_s": moved_s})
    messages = sorted([*told("CXXXXXX"), clock], key=lambda message: message[0])
    recordings = Recordings([written(tmp_path / "a.mcap", messages)])
    found = explain(
        situation(recordings, AskedTime(recordings.start_ns + SECOND // 2, SECOND), None)
    )
    assert found["clock_moved_s"] == told_s
