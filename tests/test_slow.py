"""The list of slow tests."""

import re

import pytest

from tests import slow
from tests.slow import ROOT, slow_tests, too_slow


@pytest.mark.parametrize("file", sorted({name.split("::")[0] for name in slow_tests()}))
def test_each_slow_test_is_there(file):
    text = (ROOT / file).read_text("utf-8")
    gone = {
        name
        for name in slow_tests()
        if name.startswith(f"{file}::") and not re.search(rf"def {name.split('::')[-1]}\(", text)
    }
    assert not gone, "renamed or removed: change slow.txt by hand, or run python -m tests.slow"


@pytest.fixture(autouse=True)
def _budgets(monkeypatch):
    monkeypatch.setattr(slow, "BUDGET_S", {"realtime": 160.0, "others": 300.0})


def costs(*seconds: tuple[str, float], kind: str = "others") -> list[tuple[str, str, float]]:
    return [(kind, name, cost_s) for name, cost_s in seconds]


def test_the_most_expensive_are_slow_until_the_others_fit():
    some = costs(("a::x", 100.0), ("a::x", 60.0), ("a::y", 90.0), ("b::z", 70.0), ("b::w", 60.0))
    assert too_slow(some[2:]) == []
    assert too_slow(some) == ["a::x"]
    assert too_slow([*some, *costs(("c::v", 200.0))]) == ["c::v", "a::x"]


def test_tests_in_real_time_have_a_budget_of_their_own():
    some = costs(("a::x", 290.0)) + costs(("b::y", 150.0), ("b::z", 20.0), kind="realtime")
    assert too_slow(some) == ["b::y"]


def test_each_file_keeps_its_cheapest_unless_that_is_slow_itself():
    assert too_slow(costs(("a::x", 400.0), ("b::y", 1.9), ("c::z", 2.1), ("c::v", 300.0))) == [
        "a::x",
        "c::v",
    ]
    assert too_slow(costs(*((f"{k}::x", 1.9) for k in range(200)))) == []


def test_what_judges_each_change_stays_in_the_day():
    assert too_slow(costs(("tests/test_layout.py::test_x", 400.0), ("b::y", 90.0))) == ["b::y"]
