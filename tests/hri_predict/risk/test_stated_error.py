"""What a source states of the error of a person's place counts like more of Z_d, in every mode."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from hri_predict.protocol.messages import Advice
from hri_predict.risk.areas import NamedZoneSettings
from tests.hri_predict.lost_person import lost_person
from tests.hri_predict.risk.engine_cell import MODES, SETTINGS, Cell, body
from tests.hri_predict.zones.test_toward import CALIBRATION

ERRORS_M = (0.0, 0.4, 3.0)
ROUNDING_M = 1e-9  # of sums of a few metres
APPROACH = (9.0, 3.2, 2.0, 0.9)
TICKS = 3  # at each place: one more than a release takes


@cache
def walked(
    mode: str, error_m: float, *, z_d_m: float = 0.0, calibrated: bool = False
) -> list[Advice]:
    """The advice to a robot that a person approaches, whose place is off by ``error_m``."""
    more = {"person_uncertainty_m": SETTINGS.person_uncertainty_m + z_d_m}
    cell = Cell(
        SETTINGS.model_copy(update={"mode": mode, **more}),
        calibration=CALIBRATION if calibrated else None,
    )
    errors_m = np.array([error_m])
    return [cell.step(x, errors_m=errors_m) for x in APPROACH for _ in range(TICKS)]


@pytest.mark.parametrize(
    ("mode", "calibrated"),
    [("iso", False), ("fixed", False), ("reactive", False), ("predictive", False),
     ("predictive", True)],
)  # fmt: skip
def test_an_error_counts_like_more_of_the_configured_uncertainty(mode, calibrated):
    for error_m in ERRORS_M:
        stated = walked(mode, error_m, calibrated=calibrated)
        configured = walked(mode, 0.0, z_d_m=error_m, calibrated=calibrated)
        for a, b in zip(stated, configured, strict=True):
            assert (a.level, a.reason, a.latch_id) == (b.level, b.reason, b.latch_id)
            assert a.speed_limit_m_s == pytest.approx(b.speed_limit_m_s, abs=1e-6)
            assert a.separation_m == pytest.approx(max(0.0, b.separation_m - error_m), abs=1e-6)


@MODES
def test_no_advice_is_milder_with_a_larger_error(mode):
    for nearer, farther in pairwise(walked(mode, error_m) for error_m in ERRORS_M):
        for a, b in zip(nearer, farther, strict=True):
            assert not_milder(b, a)


def not_milder(advice: Advice, than: Advice) -> bool:
    slower = advice.speed_limit_m_s <= than.speed_limit_m_s + ROUNDING_M
    return slower and advice.level.rank >= than.level.rank


@MODES
def test_a_lost_person_keeps_the_error(mode):
    def advice(error_m: float) -> Advice:
        cell = Cell(SETTINGS.model_copy(update={"mode": mode}))
        cell.step(9.0)
        lost = lost_person(10, body(4.2), cell.now_ns, error_m=error_m)
        return cell.settle(ticks=2, lost=(lost,))

    assert advice(0.5).separation_m == pytest.approx(advice(0.0).separation_m - 0.5, abs=1e-6)
    assert not_milder(advice(2.0), advice(0.0))


def test_the_detail_says_by_how_much_the_place_may_be_off():
    assert "person 10, whose place may be off by 0.40 m, " in walked("iso", 0.4)[-1].detail
    assert "whose place" not in walked("iso", 0.0)[-1].detail


def test_a_zone_of_the_user_is_occupied_by_who_may_be_in_it():
    square = [[2.0, -0.5], [3.0, -0.5], [3.0, 0.5], [2.0, 0.5]]
    zone = NamedZoneSettings(name="bench", level="stop", polygon=square)
    cell = Cell(zones=(zone,))
    for error_m, occupied in ((0.0, False), (1.5, False), (2.0, True)):
        cell.step(5.0, errors_m=np.array([error_m]))  # 2 m from it, to the bones
        assert cell.assessment.named_zones[0].occupied is occupied


def test_the_grounds_name_the_error_of_the_deciding_person():
    cell = Cell(SETTINGS.model_copy(update={"mode": "iso"}))
    cell.step(4.0, 1.0, errors_m=np.array([0.1, 0.4]))
    (grounds,) = cell.assessment.grounds
    assert (grounds.person, grounds.place_error_m) == (11, 0.4)
