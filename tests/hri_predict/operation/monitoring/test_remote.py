"""A robot that is far from all people who are seen is reported once: its place may be wrong."""

import io

import pytest

from hri_predict.base.clock import VirtualClock
from hri_predict.operation.monitoring.remote import FAR_M, WATCH_S
from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.operation.monitoring.said import alerts_of


def said(folder, separations, period_s=0.5):
    """The lines of a robot whose separations these are, and that is clear all the time."""
    out, clock = io.StringIO(), VirtualClock(0)
    alerts = alerts_of(folder, clock=clock, out=out)
    for away_m in separations:
        alerts.observe(
            (Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, separation_m=away_m),)
        )
        clock.advance_to(clock.now_ns() + int(period_s * 1e9))
    alerts.stop()
    return [line for line in out.getvalue().splitlines() if "nearer than" in line]


def test_a_robot_far_from_everybody_is_reported_once(tmp_path):
    (line,) = said(tmp_path, [31.0, 30.5] * int(4 * WATCH_S))
    assert "still clear: arm: no person was seen nearer than 30.5 m within 60 s" in line
    assert "in metres" in line


@pytest.mark.parametrize(
    "separations",
    [
        [30.0] * 100 + [FAR_M - 1] + [30.0] * 1000,  # a person was near once
        [None] * 1000,  # nobody is seen
        [30.0] * 100 + [None] * 1000,  # not for long enough
    ],
)
def test_a_robot_among_people_or_alone_is_not_reported(tmp_path, separations):
    assert said(tmp_path, separations) == []


def test_silence_between_two_advices_does_not_count(tmp_path):
    assert said(tmp_path, [30.0] * 50, period_s=100.0) == []
