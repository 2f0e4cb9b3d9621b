"""``check`` says what would be kept as evidence."""

import shutil
from dataclasses import replace
from types import SimpleNamespace

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.cli.check.commissioned import evidence_facts, evidence_line, evidence_notes
from hri_predict.operation.evidence.settings import EvidenceSettings
from tests.hri_predict.commissioning.cells import load_cell


@pytest.fixture
def facts(tmp_path):
    config = load_cell(tmp_path)

    def of(**settings):
        kept = EvidenceSettings.model_validate({"folder": "kept"} | settings)
        return evidence_facts(
            replace(config, node=config.node.model_copy(update={"evidence": kept}))
        )

    return of


def test_the_settings_are_told(facts, tmp_path):
    line = evidence_line(facts(before_s=3, of=["stop", "near_miss"]))
    assert "3 s before and 5 s after each stop, near miss" in line
    assert f"in {tmp_path / 'kept'}, up to 1000 MB" in line
    assert not (tmp_path / "kept").exists()


def test_none_is_told_too(tmp_path):
    assert evidence_line(evidence_facts(load_cell(tmp_path))) == "evidence: not recorded"
    assert evidence_notes(None) == []


def test_too_little_room_is_told_and_a_file_in_the_way_refused(facts, tmp_path, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=5e6))
        (note,) = evidence_notes(facts(max_mb=6))
    assert "only 5 MB are free there" in note
    (tmp_path / "kept").write_text("")
    with pytest.raises(ConfigError, match="is a file, not a folder; name another folder"):
        facts()
