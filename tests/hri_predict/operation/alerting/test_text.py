"""Whatever robots, zones and reasons are called: one header, one message, one topic level."""

import email.policy
import json
import re
from email.parser import BytesParser

from hypothesis import given
from hypothesis import strategies as st

from hri_predict.operation.alerting.alert import (
    ZoneAlert,
    ascii_word,
    one_line,
    payload,
    topic_level,
)
from hri_predict.operation.alerting.mail import MailHook
from hri_predict.operation.alerting.mail import message as letter
from hri_predict.operation.alerting.syslog import MAX_OCTETS, SyslogHook
from hri_predict.operation.alerting.syslog import message as syslog_message
from tests.hri_predict.operation.alerting.servers import alert

TEXTS = st.text(max_size=300) | st.sampled_from(
    ["a\r\nBcc: x@y.example", "\n<13>1 - - - - - - evil", "+/#", "$SYS", "\x00", "\ud800", "\u2028"]
)
MAIL = MailHook(kind="email", host="localhost", sender="a@b.example", recipients=["c@d.example"])
SYSLOG = SyslogHook(kind="syslog", host="localhost")
RFC_5424 = re.compile(
    rb"<(?P<pri>\d{1,3})>1 (?P<time>\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,6})?Z)"
    rb" [!-~]{1,255} [!-~]{1,48} [!-~]{1,128} [!-~]{1,32} - \xef\xbb\xbf(?P<text>.*)",
    re.DOTALL,
)
"""Section 6 of RFC 5424, for what has no structured data."""


def zone(name, state):
    return ZoneAlert(
        at="2026-03-01T14:03:07.123+00:00",
        time_s=1.0,
        zone=name,
        state=state,
        was="empty",
        entry_s=None,
    )


def test_a_new_reason_for_the_same_level_is_not_a_change_from_it_to_itself():
    same = alert(level="unknown", was="unknown")
    assert "still unknown: " in same.line()
    assert same.title().endswith(": still unknown")
    assert "clear -> stop: " in alert(level="stop").line()


@given(TEXTS, st.integers(10, 400))
def test_a_line_is_one_line_that_prints(text, limit):
    line = one_line(text, limit)
    assert len(line.splitlines()) <= 1
    assert line.isprintable()
    assert len(line) <= limit
    line.encode()  # no half of a surrogate pair


@given(TEXTS, TEXTS, TEXTS, st.integers(0, 5))
def test_an_email_has_its_headers_and_no_other(robot, detail, cell, more):
    data = letter(MAIL, cell, alert(robot=robot, detail=detail), more).as_bytes()
    read = BytesParser(policy=email.policy.default).parsebytes(data)
    assert sorted(read.keys()) == sorted(
        ["From", "To", "Subject", "Date", "Message-ID", "Auto-Submitted", "Content-Type",
         "Content-Transfer-Encoding", "MIME-Version"]
    )  # fmt: skip
    assert read["To"] == "c@d.example"
    assert not read.defects
    assert len(str(read["Subject"]).splitlines()) == 1
    body = read.get_content().replace("\r\n", "\n")
    sent = json.loads(body[body.index("{\n") :])
    assert sent == json.loads(json.dumps(payload(alert(robot=robot, detail=detail), cell, more)))


@given(TEXTS, TEXTS, TEXTS, TEXTS)
def test_a_syslog_message_is_one_of_rfc_5424(robot, detail, cell, level):
    for each in (alert(level, robot, detail=detail), zone(robot, detail)):
        data = syslog_message(SYSLOG, cell, each, 2)
        found = RFC_5424.fullmatch(data)
        assert found, data
        assert 0 <= int(found["pri"]) <= 191
        assert found["text"].decode().isprintable()
        assert len(data) <= MAX_OCTETS


def test_a_syslog_message_is_cut_between_characters():
    data = syslog_message(SYSLOG, "cell", alert(detail="\N{SNOWMAN}" * 900), 0)
    assert MAX_OCTETS - 3 < len(data) <= MAX_OCTETS
    data.decode()


@given(TEXTS)
def test_a_topic_level_is_one_level_without_wildcards(name):
    level = topic_level(name)
    assert not re.search(r"[/+#\x00-\x1f\x7f-\x9f\ud800-\udfff]", level)
    level.encode()


@given(TEXTS, TEXTS)
def test_two_names_never_share_a_topic(one, other):
    assert (topic_level(one) == topic_level(other)) == (one == other)


@given(TEXTS, st.integers(1, 60))
def test_a_word_of_a_syslog_header_is_printable_ascii(text, limit):
    assert re.fullmatch(r"[!-~]+", ascii_word(text, limit))
    assert len(ascii_word(text, limit)) <= limit
