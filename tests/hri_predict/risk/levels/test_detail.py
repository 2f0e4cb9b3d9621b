"""The text of an advice about a part that was not seen, and about more distance than usual."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.people.snapshot import Inferred
from hri_predict.protocol.reasons import Reason
from hri_predict.recording.mcap.to_dict import advice_to_dict
from hri_predict.risk.types import Grounds
from hri_predict.viewing.packing import robot_facts
from tests.hri_predict.risk.engine_cell import HISTORY, Cell


def hiding(*joints: str) -> dict[str, Any]:
    """Fields of a snapshot of one person whose ``joints`` are inferred."""
    hidden = np.array([[name in joints for name in JOINTS]])
    measured = np.repeat(~hidden[:, None], HISTORY, axis=1)
    return {"inferred": Inferred(hidden, np.where(hidden, 0.1, 0.0), measured, ~hidden)}


@pytest.mark.parametrize("seen", [True, False])
def test_every_screen_says_that_the_deciding_part_was_not_seen(seen: bool) -> None:
    cell = Cell()
    advice = cell.settle(0.7, **({} if seen else hiding(*JOINTS[1:])))
    why = cell.assessment.grounds[0]
    said = "(not seen; its zone is inferred)"
    facts = robot_facts("arm", advice, why, link="base", band_m=None)
    assert (said in advice.detail) is not seen
    assert (said in facts["near"]) is not seen
    assert ("(not seen)" in facts["pair"]) is not seen
    recorded = advice_to_dict(advice, cell.now_ns, ("arm", ["base"]), why)
    assert recorded["grounds"]["hidden_ends"] == (0 if seen else 2)


def asked_with(zones_slack_m: float, standard_slack_m: float | None) -> tuple[str, Grounds]:
    """Detail and grounds of a standing robot that may not start, after a late forecast."""
    cell = Cell()
    cell.turn = 0.0
    cell.settle(0.5)
    snapshot = cell.snapshot(0.5)
    bodies = cell.engine.zones(snapshot, None, (Reason.PREDICTOR_LATE,))
    found = cell.engine.separation(bodies, cell.engine.robots(cell.now_ns))
    people = found.robots[0].people
    assert people is not None
    people = replace(people, slack_m=zones_slack_m, limits=(0.0,) * 4)
    standard = None
    if standard_slack_m is not None:
        standard = replace(people, slack_m=standard_slack_m)
    robot = replace(found.robots[0], people=people, standard=standard)
    said = cell.engine.levels(snapshot, bodies, replace(found, robots=(robot,)))
    return said.advices[0].detail, said.grounds[0]


def test_a_distance_by_physical_limits_is_told_with_their_cause() -> None:
    detail, why = asked_with(-3.5, None)
    assert (
        "3.50 m too close for the standing robot to start, because the predictor was late and "
        "physical limits are used instead; clears when"
    ) in detail
    assert why.milder_slack_m is None


@pytest.mark.parametrize(
    ("standard_slack_m", "said"),
    [(-0.1, "0.10 m too close for the standing robot to start; clears"), (0.2, "")],
)
def test_what_is_missing_is_counted_by_the_milder_rule(standard_slack_m: float, said: str) -> None:
    """One rule that permits motion is enough: nobody has to be 3.5 m farther away."""
    detail, why = asked_with(-3.5, standard_slack_m)
    assert said in detail
    assert "3.50 m" not in detail
    assert "physical limits" not in detail
    assert (why.way, why.milder_way) == ("zones", "standard")
    assert why.pair_m is not None
    assert why.pair_needed_m == pytest.approx(why.pair_m - standard_slack_m)


def test_a_person_of_unknown_speed_is_far_too_close_by_physical_limits() -> None:
    cell = Cell()
    cell.turn = 0.0
    measured = np.zeros((1, HISTORY, len(JOINTS)), bool)
    measured[:, -1] = True
    detail = cell.settle(0.9, ticks=3, observed=measured, forecast=None).detail
    assert "m too close for the standing robot to start, by physical limits; " in detail
