"""``conformance`` on the command line: a table, JSON, an exit status, one line for a mistake."""

import json
import threading
import time
from asyncio import CancelledError

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.cli.check import conformance
from hri_predict.cli.check.conformance import ending_within
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Forecast
from hri_predict.predictors.baselines import ZeroVelocity
from tests.processes import python


def run(part, capsys, **more):
    """Exit status, and what is printed as JSON."""
    status = conformance.conformance(part=part, as_json=True, seconds=0.2, **more)
    return status, json.loads(capsys.readouterr().out)


def test_a_part_is_found_by_its_name_alone(capsys):
    status, told = run("kalman", capsys)
    assert status == 0
    assert told["part"] == "predictor:kalman"
    assert told["failed"] == 0
    assert {c["verdict"] for c in told["checks"]} == {"pass"}


def test_settings_are_changed_and_taken_from_a_configuration(capsys):
    _, told = run("predictor:zero_velocity", capsys, change=["rate_hz=10", "horizon_s=2"])
    works_on = next(c for c in told["checks"] if c["check"] == "says what it works on")
    assert "20 of horizon at 10 Hz" in works_on["detail"]
    status, told = run("link:can", capsys, config=data_path("demo.yaml"), change=["bitrate=800000"])
    assert status == 0


def test_the_status_says_that_a_check_failed(capsys, monkeypatch):
    class Broken(ZeroVelocity):
        def predict(self, history, observed):
            return Forecast(super().predict(history, observed).positions * float("nan"), None)

    load = registry.load

    def broken(kind, name):
        return Broken if name == "zero_velocity" else load(kind, name)

    monkeypatch.setattr(registry, "load", broken)
    status, told = run("predictor:zero_velocity", capsys)
    assert status == 1
    assert told["failed"] > 0
    assert conformance.conformance(part="predictor:zero_velocity", seconds=0.2) == 1
    assert "checks failed" in capsys.readouterr().out


def test_a_source_that_heard_nobody_is_not_told_to_keep_its_contract(capsys):
    assert conformance.conformance(part="source:udp", change=["port=0"], seconds=0.1) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert "keeps its contract" not in last
    assert last == (
        "source udp: no check failed, but 4 of 12 checks were skipped: no scene arrived; send to "
        "it meanwhile, and check again"
    )


def test_what_a_part_says_is_printed_as_it_is(capsys, monkeypatch):
    class Odd(ZeroVelocity):
        def predict(self, history, observed):
            raise ValueError("shape [/red] is wrong")

    load = registry.load
    monkeypatch.setattr(
        registry, "load", lambda kind, name: Odd if name == "zero_velocity" else load(kind, name)
    )
    assert conformance.conformance(part="predictor:zero_velocity") == 1
    assert "[/red]" in capsys.readouterr().out


@pytest.mark.parametrize("error", [RuntimeError("no\nway"), SystemExit(0), CancelledError()])
def test_a_part_that_cannot_be_built_is_one_line(monkeypatch, error):
    class Unbuilt(ZeroVelocity):
        def __init__(self, settings):
            raise error

    load = registry.load
    monkeypatch.setattr(
        registry, "load", lambda kind, name: Unbuilt if name == "kalman" else load(kind, name)
    )
    with pytest.raises(ConfigError, match=r"predictor 'kalman' cannot be built: [^\n]*$"):
        conformance.conformance(part="predictor:kalman")


@pytest.mark.parametrize(
    ("part", "more", "words"),
    [
        ("kalmann", {}, "did you mean 'kalman'"),
        ("serial:x", {}, "predictor, source, link"),
        ("zenoh", {}, "write one of: source:zenoh, link:zenoh"),
        ("link:cann", {}, "unknown link 'cann'"),
        ("link:serial", {}, "give 'port'"),
        ("kalman", {"change": ["rate_hz"]}, "write it as key=value"),
        ("kalman", {"change": ["rate=3"]}, "unknown key"),
        ("predictor:kalman", {"config": data_path("demo.yaml")}, ": no predictor kalman"),
    ],
)
def test_a_mistake_is_one_line(part, more, words):
    with pytest.raises(ConfigError) as caught:
        conformance.conformance(part=part, seconds=0.2, **more)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_part_that_hangs_ends_in_one_line():
    script = (
        "import threading; from hri_predict.cli.check.conformance import ending_within\n"
        "with ending_within(0.2, 'link:mine'): threading.Event().wait()"
    )
    done = python("-c", script, timeout=60)
    assert done.returncode == 1
    assert done.stderr == "error: link:mine: hangs: not finished after 0.2 s (--limit)\n"


def test_a_part_that_ends_in_time_is_left_alone():
    before = set(threading.enumerate())  # those of other tests may end meanwhile
    with ending_within(60, "link:mine"):
        (watching,) = set(threading.enumerate()) - before
    deadline = time.monotonic() + 10
    while watching.is_alive():
        assert time.monotonic() < deadline
        time.sleep(0.01)
