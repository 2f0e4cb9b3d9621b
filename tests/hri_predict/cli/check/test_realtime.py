"""``check --realtime``, as a user types it."""

import json

import pytest

from hri_predict.cli.check import realtime
from tests.hri_predict.cli.test_cli import mistake, write

__all__ = ["mistake", "write"]
pytestmark = pytest.mark.realtime


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    monkeypatch.setattr(realtime, "MEASURED_S", 0.1)


def test_it_says_what_the_machine_lacks_and_how_late_it_wakes(cli, write):
    status, out, err = cli("check", write(), "--realtime", "--json")
    found = json.loads(out)
    assert (status, err) == (0, "")
    assert {"cores", "kernel", "clock source"} <= {each["name"] for each in found["machine"]}
    for late in found["lateness"].values():
        assert late["max_us"] >= late["p99_us"] >= late["p50_us"] >= 0
    assert found["refused"] == []


def test_what_is_configured_and_cannot_be_had_ends_with_status_1(cli, write):
    path = write((("realtime",), {"cpus": [1000], "inference_cpus": [1001]}))
    status, out, err = cli("check", path, "--realtime")
    assert status == 1
    assert "realtime.cpus: not available on this machine" in out
    assert err == ""


def test_flags_of_other_checks_are_refused(mistake, write):
    assert "--listen: has no effect with --realtime" in mistake(
        "check", write(), "--realtime", "--listen", "1"
    )


def test_overlapping_cores_are_one_line(mistake, write):
    path = write((("realtime",), {"cpus": [0], "inference_cpus": [0]}))
    assert "use different cores" in mistake("check", path)
