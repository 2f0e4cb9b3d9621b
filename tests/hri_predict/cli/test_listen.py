"""What ``listen`` shows of messages, by whether their schema is ours."""

import json
from dataclasses import replace

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.cli.listen import Printer, _settings, listen
from hri_predict.contracts import registry
from hri_predict.contracts.link import LinkSettings
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Advice, Level, NodeState, Schema, Status
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.reception import ReceiveCounters

OURS = Schema(SCHEMA_VERSION, SCHEMA_HASH)
OTHER = Schema(SCHEMA_VERSION + 1, 0x1234)
CLEAR = Advice(robot=1, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=1.0)
STATUS = Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=1, predictor=0, cycle=0)


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


def test_the_text_names_the_deciding_body_part(capsys):
    printer = Printer(alerts=False, as_json=False)
    for part in (10, 200):  # 200: of another skeleton
        printer.show(OURS, 0.0)
        printer.show(replace(CLEAR, body_part=part), 0.0)
    printer.show(CLEAR, 0.0)
    out = capsys.readouterr().out
    assert "body_part=10 (l_foot)" in out
    assert "body_part=200  " in out
    assert out.count("body_part") == 2


def test_before_a_schema_everything_is_unknown(listened):
    advice, status = listened(CLEAR, STATUS)
    assert (advice["robot"], advice["level"]) == (1, "unknown")
    assert status["level"] == "unknown"
    for line in (advice, status):
        assert line["why"].startswith(
            "no Schema received yet; this receiver is built for version 3"
        )
        assert not {"speed_limit_m_s", "reason", "node_state", "people"} & set(line)


def test_another_schema_makes_everything_unknown_and_is_named(listened):
    _, clear, schema, advice = listened(OURS, CLEAR, OTHER, CLEAR)
    assert clear["level"] == "clear"
    assert (schema["version"], schema["hash"], schema["matches"]) == (4, "0x00001234", False)
    why = (
        f"received Schema of version 4, hash 0x00001234; "
        f"this receiver is built for version {SCHEMA_VERSION}, hash {SCHEMA_HASH:#010x}"
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


@pytest.mark.parametrize(
    ("link", "words"),
    [
        ("serial", "give serial:PORT or can:INTERFACE:CHANNEL"),
        ("can:can0", "give serial:PORT or can:INTERFACE:CHANNEL"),
        ("zenoh:cell", "for another kind of link, KIND and --set key=value"),
        ("nothing", "listen nothing: give serial:PORT"),
    ],
)
def test_a_link_that_is_none_is_one_line(link, words):
    with pytest.raises(ConfigError) as caught:
        _settings(link, {}, {}, [])
    assert words in str(caught.value)


def test_any_setting_of_a_link_may_be_given():
    _, settings = _settings("serial:/dev/ttyX0", {"baudrate": 9600}, {}, ["parity=even"])
    assert settings.model_dump().items() >= {"baudrate": 9600, "parity": "even"}.items()


def test_a_kind_of_link_without_a_transport_is_one_line(monkeypatch):
    class Bare:
        settings_model = LinkSettings

    monkeypatch.setattr(registry, "names", lambda kind: ["bare"])
    monkeypatch.setattr(registry, "load", lambda kind, name: Bare)
    with pytest.raises(ConfigError, match=r"link 'bare' cannot be built: .*make_transport[^\n]*$"):
        listen(link="bare", seconds=0.1)


def test_errors_are_told_once_a_second_and_many_with_what_may_be_wrong(capsys):
    printer, counters = Printer(True, as_json=True), ReceiveCounters()
    for k in range(200):
        counters.counter_errors += k >= 10
        printer.errors(counters, 0.02 * k)
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["new"] for line in told] == [1, 50, 50, 50]
    assert ["why" in line for line in told] == [False, True, True, True]
    assert "two nodes with the same ids" in told[-1]["why"]
    assert told[-1]["counter_errors"] == 151
