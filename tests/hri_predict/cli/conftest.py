import pytest


@pytest.fixture(autouse=True)
def distance_unmeasured(monkeypatch):
    """To measure the working distance takes ``check`` seconds; ``check/test_distance.py`` does."""
    facts = {"why": "not measured in this test"}
    monkeypatch.setattr("hri_predict.cli.check.zones.distance_facts", lambda *_: facts)
