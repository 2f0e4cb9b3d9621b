"""The delay budget: its terms, the worst link, and the horizon."""

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.contracts.link import LinkSettings
from hri_predict.risk.delay_budget import DelayBudget

FAST = LinkSettings(
    name="fast", kind="can", delay_s=0.002, silence_timeout_s=0.1, reaction_s=0.02, robots=["a"]
)
SLOW = LinkSettings(
    name="slow", kind="serial", delay_s=0.01, silence_timeout_s=0.2, reaction_s=0.05, robots=["b"]
)
BOTH = LinkSettings(
    name="both", kind="can", delay_s=0.001, silence_timeout_s=0.148, reaction_s=0.001
)


def test_terms_sum_to_the_reaction_time():
    budget = DelayBudget.from_settings(25.0, [SLOW], 0.12)
    terms = budget.terms()
    assert terms == pytest.approx(
        {
            "age": 0.12,
            "encoding": 0.02,
            "cycle": 0.04,
            "link_delay": 0.01,
            "silence_timeout": 0.2,
            "reaction": 0.05,
        }
    )
    assert sum(terms.values()) == pytest.approx(budget.reaction_s(0.12))
    assert budget.reaction_s(0.05) == pytest.approx(0.05 + budget.after_now_s())


def test_each_robot_has_its_own_worst_link():
    budget = DelayBudget.from_settings(50.0, [FAST, SLOW, BOTH], 0.1)
    own = 0.01 + 0.02
    assert budget.after_now_s("a") == pytest.approx(own + 0.15)  # "both" is slower than "fast"
    assert budget.after_now_s("b") == pytest.approx(own + 0.26)
    assert budget.after_now_s() == pytest.approx(own + 0.26)
    assert budget.terms("a")["silence_timeout"] == 0.148


def test_a_controller_refuses_by_its_own_robots_delays():
    budget = DelayBudget.from_settings(50.0, [FAST, SLOW], 0.1)
    assert budget.oldest_s(["a", "b"]) == pytest.approx(
        {"fast": 0.1 + 0.03 + 0.122 - 0.02, "slow": 0.1 + 0.03 + 0.26 - 0.05}
    )
    # on a link for several robots the one with the shortest T_r decides
    budget = DelayBudget.from_settings(50.0, [FAST, SLOW, BOTH], 0.1)
    all_three = budget.oldest_s(["a", "b"])
    assert all_three["both"] == pytest.approx(0.1 + 0.03 + 0.15 - 0.001)
    assert all_three["fast"] == pytest.approx(0.1 + 0.03 + 0.15 - 0.02)
    for link in (FAST, SLOW, BOTH):
        for robot in link.robots or ("a", "b"):
            brakes_s = all_three[link.name] + link.reaction_s
            assert brakes_s <= budget.reaction_s(0.1, robot) + 1e-12


def test_a_robot_that_no_link_advises_has_the_nodes_delays_alone():
    assert DelayBudget.from_settings(25.0, [SLOW], 0.1).after_now_s("a") == pytest.approx(0.06)
    assert DelayBudget.from_settings(25.0, [], 0.1).after_now_s() == pytest.approx(0.06)


def test_a_link_that_only_reads_stops_no_robot_and_does_not_count():
    class Reading(LinkSettings):
        advises = False

    reads = Reading(name="state", kind="modbus_client", silence_timeout_s=0.5, robots=["a"])
    assert DelayBudget.from_settings(25.0, [reads, FAST], 0.1).terms("a")["silence_timeout"] == 0.1


def test_a_budget_past_the_horizon_is_refused():
    budget = DelayBudget.from_settings(25.0, [SLOW], 0.12)  # T_r 0.44 s
    budget.check("b", 0.56, 1.0, False)
    with pytest.raises(ConfigError, match=r"predictor.horizon_s.*robot b.*0.440.*0.600.*1.000"):
        budget.check("b", 0.6, 1.0, False)
    with pytest.raises(ConfigError, match=r"0\.120 s of it are source.stale_s"):
        budget.check("b", 0.6, 1.0, False)
    budget.check("b", 0.6, 1.0, True)
