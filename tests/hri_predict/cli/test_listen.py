"""What ``listen`` shows of messages, by whether their schema is ours."""

import json

import pytest

from hri_predict.cli.listen import Printer
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Advice, Level, NodeState, Schema, Status
from hri_predict.reasons import Reason

OURS = Schema(SCHEMA_VERSION, SCHEMA_HASH)
OTHER = Schema(SCHEMA_VERSION + 1, 0x1234)
CLEAR = Advice(1, Level.CLEAR, Reason.NONE, speed_limit_m_s=1.0)
STATUS = Status(NodeState.RUNNING, Reason.NONE, 1, 0, 0)


@pytest.fixture
def listened(capsys):
    """Show messages one after the other (``None``: a long silence); gives the JSON lines."""

    def show(*messages, alerts=False):
        printer = Printer(alerts, as_json=True)
        for message in messages:
            if message is None:
                printer.forget()
            else:
                printer.show(message, 0.0)
        return [json.loads(line) for line in capsys.readouterr().out.splitlines()]

    return show


def test_fields_are_shown_once_the_schema_is_ours(listened):
    _, advice, status = listened(OURS, CLEAR, STATUS)
    assert (advice["level"], advice["speed_limit_m_s"]) == ("clear", 1.0)
    assert (status["node_state"], status["people"]) == ("running", 1)
    assert "why" not in advice


def test_before_a_schema_everything_is_unknown(listened):
    advice, status = listened(CLEAR, STATUS)
    assert (advice["robot"], advice["level"]) == (1, "unknown")
    assert status["level"] == "unknown"
    for line in (advice, status):
        assert line["why"].startswith("no Schema heard yet; this is built for version 1")
        assert not {"speed_limit_m_s", "reason", "node_state", "people"} & set(line)


def test_another_schema_makes_everything_unknown_and_is_named(listened):
    _, clear, schema, advice = listened(OURS, CLEAR, OTHER, CLEAR)
    assert clear["level"] == "clear"
    assert (schema["version"], schema["hash"], schema["matches"]) == (2, "0x00001234", False)
    why = (
        f"heard Schema of version 2, hash 0x00001234; "
        f"this is built for version {SCHEMA_VERSION}, hash {SCHEMA_HASH:#010x}"
    )
    assert (advice["level"], advice["why"]) == (schema["level"], schema["why"]) == ("unknown", why)


def test_after_a_long_silence_the_schema_must_come_again(listened):
    lines = listened(OURS, CLEAR, None, CLEAR, OURS, CLEAR)
    levels = [line.get("level") for line in lines]
    assert levels == [None, "clear", "unknown", None, "clear"]


def test_alerts_say_each_trouble_with_the_schema_once(listened):
    twice = [OURS, CLEAR, OTHER, CLEAR, CLEAR]
    lines = listened(*twice, OTHER, CLEAR, OURS, CLEAR, CLEAR, alerts=True)
    shown = [(line["message"], line.get("level")) for line in lines]
    bad = [("schema", "unknown"), ("advice", "unknown")]
    good = [("schema", None), ("advice", "clear")]
    assert shown == [*good, *bad, *good]
