"""``explain`` and ``report``, as a user types them."""

import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser

import pytest
from typer.testing import CliRunner

from hri_predict.base.errors import HriPredictError
from hri_predict.base.skeleton import CANONICAL
from hri_predict.cli.commands import app
from tests.hri_predict.explaining.made_up import advice, told, written

HOSTILE = "<script>alert(1)</script>\"'&\x1b[31m"


def run(*words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["explain", "--at", "12:00:00"], "have no UTC"),
        (["explain", "--at", "99"], "not recorded; these recordings are from 0.00 to 5.5"),
        (["explain", "--at", "3", "--robot", "arn"], "no robot has this name; did you mean 'arm'?"),
        (["explain", "--at", "3", "--picture", "why.gif"], "ends in .png or .svg"),
        (["explain", "--picture", "why.png"], "--picture: has no effect without --at"),
        (["explain", "--robot", "arn"], "no such robot; did you mean 'arm'?; available: arm"),
        (["explain", "--next"], "--next: has no effect without --at"),
        (["report", "--out", "shift.pdf"], "the page is HTML"),
        (["report", "--from", "3", "--to", "1"], "not after"),
        (["report", "--from", "90"], "no advice was recorded in that time"),
    ],
)
def test_a_mistake_is_one_line(near, words, says):
    command, *options = words
    result = CliRunner().invoke(app, [command, str(near), *options])
    assert isinstance(result.exception, HriPredictError)
    assert says in str(result.exception)
    assert "\n" not in str(result.exception)


def test_without_a_time_every_slowdown_has_a_line(near):
    head, *lines = run("explain", near).splitlines()
    assert head.split()[:3] == ["from", "for", "cost"]
    assert [line.split()[7] for line in lines] == ["STOP", "STOP"]
    rows = json.loads(run("explain", near, "--json"))["slowdowns"]
    assert [row["reason"] for row in rows] == ["SPEED_UNKNOWN", "PERSON_NEAR"]
    for row in rows:  # what is listed can be asked
        found = json.loads(run("explain", near, "--at", row["at"], "--json"))
        assert (found["level"], found["reason"]) == (row["level"], row["reason"])


def test_a_pipe_gets_whole_lines_and_a_terminal_gets_its_width(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    path = written(tmp_path / "a.mcap", told("CCUUCC", 1.0))
    (row,) = json.loads(run("explain", path, "--json"))["slowdowns"]
    assert run("explain", path).splitlines()[-1].endswith(row["why"])
    near_it = run("explain", path, "--at", "12:00:01")
    assert row["why"] in near_it
    monkeypatch.setattr("hri_predict.cli.explain.explain._list_width", lambda: 60)
    line = run("explain", path).splitlines()[-1]
    assert len(line) <= 60
    assert line.endswith("…")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no /dev/full")
@pytest.mark.long
def test_a_full_disk_of_the_output_is_not_blamed_on_the_recording(near):
    with open("/dev/full", "wb") as full:
        command = [sys.executable, "-m", "hri_predict", "explain", str(near)]
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: the output cannot be written: No space left on device")


def test_the_list_names_each_day(tmp_path):
    """The second stop is a day later."""
    later = [(at + 86400.0, topic, message) for at, topic, message in told("CXC")]
    path = written(tmp_path / "a.mcap", [*told("CXC"), *later])
    days = [line for line in run("explain", path).splitlines() if line.endswith(", UTC")]
    assert days == ["2026-03-08, UTC", "2026-03-09, UTC"]


def test_the_text_fits_80_columns_and_begins_with_the_answer(near, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    text = run("explain", near, "--at", "3.5")
    assert max(map(len, text.splitlines())) <= 80
    first = " ".join(text.split("\n\n")[0].split())
    assert re.fullmatch(
        r"3\.5 s arm STOP because person 1's [a-z ]+ was \d\.\d\d m from the [a-z0-9 ]+; "
        r"\d\.\d\d m were needed at \d\.\d\d m/s",
        first,
    )
    for heading in ("Asked of the robot", "Seen", "Separation", "Forecast", "History"):
        assert f"\n{heading}" in text


def test_the_terms_sum_up_to_what_is_told(near):
    found = json.loads(run("explain", near, "--at", "3.5", "--json"))["separation"]
    assert set(found["terms_m"]) == {"s_h", "s_r", "s_s", "c", "z_d", "z_r"}
    total = sum(found["terms_m"].values())
    # seven numbers, each rounded to 0.1 mm
    assert found["protective_m"] == pytest.approx(total, abs=7 * 5e-5)
    short_m = found["needed_m"] - found["separation_m"]
    assert found["short_m"] == pytest.approx(short_m, abs=2e-4)
    assert found["body_part"] in CANONICAL.segment_names


def test_a_forecast_is_compared_with_what_came(near):
    """They walk at 1.2 m/s: a forecast of their way errs less than standing still would."""
    errors = json.loads(run("explain", near, "--at", "3.5", "--json"))["forecast"]["errors"]
    assert [error["ahead_s"] for error in errors] == [0.2, 0.4, 0.8]
    assert 0 < errors[0]["mean_m"] < 0.24
    assert errors[0]["mean_m"] < errors[2]["mean_m"]


def test_at_a_clear_time_the_nearest_slowdowns_are_named(tmp_path):
    path = written(tmp_path / "a.mcap", told("CCSSCCCCXXCC", 1.0))
    text = run("explain", path, "--at", "12:00:05")
    assert "neither slowed nor stopped" in text.splitlines()[0]
    assert "--at 2026-03-08T12:00:02.00" in text
    assert "--at 2026-03-08T12:00:08.00" in text
    after = json.loads(run("explain", path, "--at", "12:00:05", "--next", "--json"))
    assert (after["at"], after["level"]) == ("12:00:08.0", "STOP")


def test_a_whole_second_is_asked_not_its_beginning(tmp_path):
    path = written(tmp_path / "a.mcap", told("C" * 13 + "X" * 3 + "C" * 20))
    assert json.loads(run("explain", path, "--at", "12:00:01", "--json"))["at"] == "12:00:01.3"


def test_a_long_stop_is_explained_from_its_beginning(tmp_path):
    """Latched for twenty minutes: what it was for lies far before what is looked at first."""
    waits = "before; latch 4: lost"
    messages = told("CCX") + [
        (k, "/advice/arm", advice("STOP", "LATCHED", detail=waits)) for k in range(1, 1200)
    ]
    path = written(tmp_path / "a.mcap", messages)
    found = json.loads(run("explain", path, "--at", "12:19:00", "--json"))
    assert "latch 4" in found["answer"]
    assert "a person was" in found["answer"]  # the phase before, of PERSON_NEAR
    assert found["history"]["from"] == "12:00:00.2"


@pytest.mark.long
def test_a_picture_is_drawn(near, tmp_path):
    pytest.importorskip("matplotlib")
    for name, begins in (("why.png", b"\x89PNG"), ("why.svg", b"<?xml")):
        run("explain", near, "--at", "3.5", "--picture", tmp_path / name)
        data = (tmp_path / name).read_bytes()
        assert data.startswith(begins)
        assert len(data) > 10_000


@pytest.mark.long
def test_without_matplotlib_a_picture_is_one_line(near, tmp_path):
    code = (
        "import sys; sys.modules['matplotlib'] = None; sys.argv[0] = 'hri-predict'; "
        "from hri_predict.__main__ import main; sys.exit(main())"
    )
    words = [sys.executable, "-c", code, "explain", str(near), "--at", "3.5", "--picture"]
    done = subprocess.run(
        [*words, str(tmp_path / "a.png")], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("error: plots need matplotlib; install it with")
    assert "[plots]'" in line


class Page(HTMLParser):
    """Collects what a browser would load or run."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.loaded: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.loaded += [f"{k}={v}" for k, v in attrs if k in ("src", "href") or k[:2] == "on"]


def test_a_report_is_one_page_that_loads_nothing(near, tmp_path):
    run("report", near, "--out", tmp_path / "shift.html")
    html = (tmp_path / "shift.html").read_text()
    page = Page()
    page.feed(html)
    assert "svg" in page.tags
    assert not page.tags & {"script", "img", "link", "iframe"}
    assert page.loaded == []
    assert "url(" not in html
    assert re.search(r"hri-predict explain \S+cell\.mcap --at \d\.\d\d --robot arm", html)


def test_what_a_recording_holds_is_only_text(tmp_path):
    messages = [
        (at, topic, {**message, "name": HOSTILE, "reason": HOSTILE, "detail": HOSTILE})
        for at, topic, message in told("CXXC")
    ]
    node = {"now_ns": 0, "people": {}, "node": {}, "links": {HOSTILE: {"counters": {HOSTILE: 3}}}}
    status = {"reasons": [HOSTILE, 7, None], "named_zones": [1], "reason": HOSTILE}
    messages += [(0.05, "/node", node), (0.05, "/status", status), (0.35, "/node", node)]
    path = written(tmp_path / "a.mcap", sorted(messages, key=lambda m: m[0]), cell=HOSTILE)
    run("report", path, "--out", tmp_path / "shift.html")
    page = Page()
    page.feed((tmp_path / "shift.html").read_text())
    assert "script" not in page.tags
    for words in ([], ["--at", "12:00:00"]):
        assert "\x1b" not in run("explain", path, *words)


def test_messages_that_make_no_sense_are_survived(tmp_path):
    """Each field of each message in turn is something else."""
    base = advice("STOP", "PERSON_NEAR", separation_m=0.4, needed_m=0.5, speed_m_s=0.3)
    base |= {"body_part": 3, "robot_link": 1, "grounds": {"person": 1, "terms_m": {"s_h": 1}}}
    strange: list[object] = [None, "x", -1, 1e308, [], {}, True, [[1]], 10**30]
    messages = [(0.0, "/advice/arm", base)]
    at = 0.0
    for key in [*base, "latch_id"]:
        for value in strange:
            at += 0.04
            messages.append((at, "/advice/arm", {**base, "name": "arm", key: value}))
    others = ("/scene", "/forecast", "/zones", "/node", "/status", "/clock", "/view/scene")
    keys = ("people", "ids", "capture_ns", "positions", "capsules", "steps", "times_s", "links",
            "reasons", "named_zones", "node", "now_ns", "entities", "utc_moved_s")  # fmt: skip
    for k, value in enumerate(strange):
        messages += [(k * 0.3, topic, dict.fromkeys(keys, value)) for topic in others]
    messages.sort(key=lambda m: m[0])
    path = written(tmp_path / "a.mcap", messages)
    run("explain", path)
    for at in range(0, 8):
        run("explain", path, "--at", at, "--json")
        run("explain", path, "--at", at)
    run("report", path, "--out", tmp_path / "shift.html")
