"""``check`` says how near a person who stands may be, and what makes that smaller."""

from dataclasses import replace

import pytest

from hri_predict.cli.check.zones import distance_facts, distance_lines
from hri_predict.run import assemble
from hri_predict.run import config as configuration


def facts_of(name):
    config = configuration.load(configuration.shipped(name))
    config = config.with_predictor("constant_velocity", horizon_s=1.2)
    return distance_facts(config, assemble.build_predictor(config))


def test_the_sum_and_the_three_largest_terms_each_with_a_remedy():
    facts = facts_of("demo.yaml")
    costs_m = facts["costs_m"]
    assert facts["total_m"] == pytest.approx(sum(costs_m.values()) + facts["rest_m"])
    first, *terms = distance_lines(facts)
    assert f"{facts['total_m']:.2f} m from the base to a person who stands" in first
    assert len(terms) == 3
    largest = sorted(costs_m.values(), reverse=True)[:3]
    for line, cost_m in zip(terms, largest, strict=True):
        assert line.strip().startswith(f"{100 * cost_m:.0f} cm: ")
        assert "; " in line  # what makes it smaller


@pytest.mark.parametrize(
    ("name", "why"),
    [("live_udp.yaml", "plan: pick_and_place"), ("simulate_mobile.yaml", "its base moves")],
)
def test_where_it_cannot_be_known_one_line_says_why(name, why):
    (line,) = distance_lines(facts_of(name))
    assert line.startswith("working distance: not known: ")
    assert why in line


@pytest.mark.parametrize(
    ("risk", "terms"), [({"mode": "fixed", "fixed_radius_m": 2.0}, 1), ({"mode": "iso"}, 3)]
)
def test_only_terms_that_cost_something_and_what_decides_instead(risk, terms):
    config = configuration.load(configuration.shipped("demo.yaml"))
    config = config.with_predictor("constant_velocity", horizon_s=1.2)
    node = config.node
    changed = node.model_copy(update={"risk": node.risk.model_copy(update=risk)})
    config = replace(config, node=changed)
    facts = distance_facts(config, assemble.build_predictor(config))
    assert min(facts["costs_m"].values()) >= 0
    first, *lines = distance_lines(facts)
    assert len(lines) == terms
    assert ("risk.fixed_radius_m" in first) == (risk["mode"] == "fixed")
