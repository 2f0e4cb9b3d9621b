"""Restart types and the causes of a latch: either one sets the other, contradictions are said."""

import pytest
from pydantic import ValidationError

from hri_predict.risk.settings import RiskSettings


@pytest.mark.parametrize(
    ("given", "restart", "latch"),
    [
        ({}, "automatic", []),
        ({"latch": []}, "automatic", []),
        ({"restart": "automatic"}, "automatic", []),
        ({"latch": ["lost"]}, "manual", ["lost"]),
        ({"restart": "manual"}, "manual", ["stop", "start", "blind", "lost"]),
        ({"restart": "supervised"}, "supervised", ["stop", "start", "blind", "lost"]),
        ({"restart": "supervised", "latch": ["stop"]}, "supervised", ["stop"]),
    ],
)
def test_either_sets_the_other_and_survives_being_written(given, restart, latch):
    settings = RiskSettings(**given)
    assert (settings.restart, settings.latch) == (restart, latch)
    assert RiskSettings(**settings.model_dump()) == settings


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"restart": "automatic", "latch": ["stop"]}, "'restart: manual'"),
        ({"restart": "manual", "latch": []}, "leave latch out"),
        ({"restart": "supervised", "latch": []}, "leave latch out"),
        ({"restart": "monitored"}, "'automatic', 'manual' or 'supervised'"),
    ],
)
def test_contradictions_are_said_with_the_remedy(given, says):
    with pytest.raises(ValidationError, match=says):
        RiskSettings(**given)
