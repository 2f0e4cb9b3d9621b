"""Doubts of a merged source are logged when they begin; one that flickers fills no log."""

import logging

from hri_predict.contracts.scene import Doubt
from hri_predict.people.merging.source import EVERY_NS, DoubtLog
from hri_predict.protocol.reasons import Reason

APART = "sensors a and b are {} cm apart"
SILENT = Doubt(Reason.SENSOR_SILENT, "sensor c is silent")
PERIOD_NS = 100_000_000


def apart(centimetres: int) -> Doubt:
    return Doubt(Reason.SENSORS_DISAGREE, APART.format(centimetres))


def warnings(caplog):
    return [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]


def test_a_doubt_that_lasts_is_logged_once_whatever_its_centimetres(caplog):
    doubts = DoubtLog()
    for k in range(2 * EVERY_NS // PERIOD_NS):
        doubts.note([apart(20 + k % 3)], k * PERIOD_NS)
    assert warnings(caplog) == ["source 'merged': sensors a and b are 20 cm apart"]


def test_a_doubt_that_flickers_is_logged_once_a_minute_and_counted(caplog):
    doubts = DoubtLog()
    for k in range(EVERY_NS // PERIOD_NS):
        doubts.note([apart(20)] * (k % 2), k * PERIOD_NS)
    assert len(warnings(caplog)) == 1
    doubts.note([], EVERY_NS + PERIOD_NS)
    doubts.note([apart(30)], EVERY_NS + 2 * PERIOD_NS)
    assert warnings(caplog)[1:] == [
        "source 'merged': sensors a and b: 299 more times within a minute",
        "source 'merged': sensors a and b are 30 cm apart",
    ]


def test_another_doubt_is_logged_at_once_beside_one_that_flickers(caplog):
    doubts = DoubtLog()
    for k in range(100):
        doubts.note([apart(20)] * (k % 2), k * PERIOD_NS)
    doubts.note([SILENT], 100 * PERIOD_NS)
    assert warnings(caplog)[-1] == "source 'merged': sensor c is silent"
    assert len(warnings(caplog)) == 2


def test_texts_that_never_come_again_take_no_memory(caplog):
    doubts = DoubtLog()
    for k in range(1000):
        doubts.note([Doubt(Reason.INPUT_IMPOSSIBLE, f"floor {k}")], k * EVERY_NS // 10)
    assert len(doubts._said) <= 10
