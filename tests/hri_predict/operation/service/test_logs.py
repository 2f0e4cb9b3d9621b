"""The log as lines for programs, in the journal, and under a flood."""

import contextlib
import io
import json
import logging
import os
import re

import pytest

from hri_predict.operation.service import logs
from hri_predict.operation.service.logs import Line, Log, RateLimit, in_journal, severity


class Time:
    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def time():
    return Time()


def logger_of(log):
    logger = logging.Logger("hri_predict.test", logging.DEBUG)
    logger.addHandler(log)
    return logger


def test_a_json_line_has_utc_severity_logger_and_message():
    stream = io.StringIO()
    log = Log(stream)
    log.say_as("json")
    logger_of(log).warning("robot %s\nstands", "arm")
    (line,) = stream.getvalue().splitlines()
    said = json.loads(line)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", said.pop("time"))
    assert said == {
        "severity": "warning",
        "logger": "hri_predict.test",
        "message": "robot arm\nstands",
    }


def test_an_exception_stays_in_one_json_line():
    stream = io.StringIO()
    log = Log(stream)
    log.say_as("json")
    try:
        raise ValueError("wrong")
    except ValueError:
        logger_of(log).exception("it failed")
    (line,) = stream.getvalue().splitlines()
    assert "ValueError: wrong" in json.loads(line)["error"]


def test_each_line_in_the_journal_begins_with_its_severity():
    stream = io.StringIO()
    logger_of(Log(stream, in_journal=True)).error("first\nsecond")
    assert stream.getvalue() == "<3>error: first\n<3>second\n"


def test_severities_are_those_of_syslog():
    levels = (logging.CRITICAL, logging.ERROR, logging.WARNING, logging.INFO, logging.DEBUG)
    assert [severity(level) for level in levels] == [2, 3, 4, 6, 7]


def test_only_the_stream_that_systemd_named_is_the_journal(tmp_path):
    with (tmp_path / "log").open("w") as stream:
        there = os.fstat(stream.fileno())
        named = {"JOURNAL_STREAM": f"{there.st_dev}:{there.st_ino}"}
        assert in_journal(stream, named)
        assert not in_journal(stream, {"JOURNAL_STREAM": "1:1"})
        assert not in_journal(stream, {})
    assert not in_journal(io.StringIO(), named)


def test_a_flood_of_one_message_is_cut_counted_and_told(time):
    stream = io.StringIO()
    log = Log(stream, monotonic_s=time)
    log.limit.lines = 3
    logger = logger_of(log)
    for i in range(10):
        logger.warning("lost packet %d", i)
    logger.warning("something else")
    assert stream.getvalue().count("lost packet") == 3
    assert "something else" in stream.getvalue()
    assert log.limit.left_out == 7
    time.now_s += 60.0
    logger.warning("lost packet %d", 10)
    told, newest = stream.getvalue().splitlines()[-2:]
    assert "left out 7 lines like: lost packet %d" in told
    assert "lost packet 10" in newest


def test_what_was_left_out_is_told_at_the_end_too(time):
    stream = io.StringIO()
    log = Log(stream, monotonic_s=time)
    log.limit.lines = 1
    for _ in range(3):
        logger_of(log).warning("again")
    log.close()
    assert "left out 2 lines like: again" in stream.getvalue().splitlines()[-1]


def test_any_number_of_messages_takes_little_memory(time):
    limit = RateLimit(1, time)
    for i in range(10_000):
        limit.over()
        assert limit.takes(("a", 30, f"message {i}"))
    assert len(limit._windows) <= logs.MOST_MESSAGES


def test_lines_for_a_full_disk_are_counted_and_disturb_nobody():
    with open("/dev/full", "w") as full:  # every write fails with "no space left"
        log = Log(full)
        logger_of(log).warning("nobody reads this")
        assert log.failures == 1
        with contextlib.suppress(OSError):  # the line is still in the file's buffer
            full.close()
    assert logs.counters()["log_lines_lost"] == 0  # of the program's own log


def line_of(in_journal):
    record = logging.LogRecord("node", logging.WARNING, __file__, 1, "robot %s", ("arm",), None)
    return Line(with_time=not in_journal).format(record)


def test_a_line_has_its_time_and_its_severity():
    assert re.fullmatch(r"\d\d:\d\d:\d\d\.\d{3}Z warning: robot arm", line_of(False))


def test_the_journal_keeps_the_time_itself():
    assert line_of(True) == "warning: robot arm"
