"""Lines of the log: with the time on a terminal, without it in the journal, which has its own."""

import logging
import re

from hri_predict.operation.service.logs import Line


def line_of(in_journal):
    record = logging.LogRecord("node", logging.WARNING, __file__, 1, "robot %s", ("arm",), None)
    return Line(with_time=not in_journal).format(record)


def test_a_line_has_its_time_and_its_severity():
    assert re.fullmatch(r"\d\d:\d\d:\d\d\.\d{3}Z warning: robot arm", line_of(False))


def test_the_journal_keeps_the_time_itself():
    assert line_of(True) == "warning: robot arm"
