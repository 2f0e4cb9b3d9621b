"""The remedies of ``check`` fit the cell: none names what the cell has already, or cannot have."""

from dataclasses import replace

import pytest

from hri_predict.cli.check.remedies import BEST, remedy
from hri_predict.run import config as configuration
from hri_predict.run.working_distance.waterfall import TERMS


@pytest.fixture(scope="module")
def cell():
    return configuration.load(configuration.shipped("demo.yaml"))


def with_node(cell, **changes):
    return replace(cell, node=cell.node.model_copy(update=changes))


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.key)
def test_each_term_has_one(cell, term):
    assert remedy(term.key, cell, ["l_foot"])


def test_the_key_of_the_cycle_is_the_one_that_acts(cell):
    for ticks in ("fixed", "capture"):  # T_r has 1 / rate_hz, whatever max_rate_hz is
        assert "raise rate_hz" in remedy("cycle", with_node(cell, ticks=ticks), [])
    assert "ticks: capture" in remedy("age", with_node(cell, ticks="fixed"), [])
    assert "ticks: capture" not in remedy("age", with_node(cell, ticks="capture"), [])


def test_joints_that_are_inferred_are_named(cell):
    lacking, hidden = ["l_foot", "head_top"], ["r_foot"]
    assert "a tracker that also delivers left foot, head top (" in remedy("unseen", cell, lacking)
    both = remedy("unseen", cell, lacking, hidden)
    assert both.startswith("move or add a camera so that it sees right foot, and use a tracker ")


def test_a_better_predictor_is_named_only_if_there_is_one(cell):
    assert f"use predictor {BEST}" not in remedy("seen", cell.with_predictor(BEST), [])
    other = cell.with_predictor("constant_velocity")
    assert f"use predictor {BEST}" in remedy("seen", other, [])


def test_a_margin_of_0_is_not_to_be_lowered(cell):
    risk = cell.node.risk
    for margin_m, lower in ((0.25, True), (0.0, False)):
        changed = with_node(cell, risk=risk.model_copy(update={"slow_margin_m": margin_m}))
        assert ("lower slow_margin_m" in remedy("margins", changed, [])) == lower


def test_a_payload_is_asked_for_where_none_is_stated(cell):
    robots = cell.node.robots
    for payload_kg, asked in ((None, True), (2.0, False)):
        changed = [robot.model_copy(update={"payload_kg": payload_kg}) for robot in robots]
        assert ("payload_kg" in remedy("stopping", with_node(cell, robots=changed), [])) == asked


def test_the_circle_of_mode_fixed_has_no_margin_to_slow_down(cell):
    for mode, lower in (("iso", True), ("fixed", False)):
        risk = cell.node.risk.model_copy(update={"mode": mode, "slow_margin_m": 0.25})
        assert ("slow_margin_m" in remedy("margins", with_node(cell, risk=risk), [])) == lower
