"""Rows of a finished block are taken only if they are those of its episodes."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from hri_sim.simulation import _todo
from hri_sim.simulation.results.outcome import Outcome, Prediction
from hri_sim.simulation.results.rows import are_of
from hri_sim.simulation.store import Store
from hri_sim.simulation.work import SimulationPlan

EPISODES, VARIANTS = [0, 2], ["unprotected", "iso"]


def rows():
    made = {
        "outcomes": [
            {"variant": name} | asdict(Outcome(index=i, motion="walk", seconds=3.0, lead_s=[0.5]))
            for i in EPISODES
            for name in VARIANTS
        ],
        "predictions": [asdict(Prediction(index=i, motion="walk")) for i in EPISODES],
        "checks": [{"index": 2, "variant": "iso", "disagreement": ""}],
    }
    return json.loads(json.dumps(made))


def test_own_rows_are_taken():
    assert are_of(rows(), EPISODES, VARIANTS)
    assert not are_of(rows(), EPISODES, ["unprotected"])
    assert not are_of(rows(), [0, 1], VARIANTS)


DAMAGE = {
    "a key gone": lambda r: r.pop("outcomes"),
    "a key more": lambda r: r.update(mood=1),
    "no list": lambda r: r.update(outcomes={}),
    "a row gone": lambda r: r["outcomes"].pop(),
    "a row twice": lambda r: r["outcomes"].append(r["outcomes"][0]),
    "no row": lambda r: r["outcomes"].__setitem__(0, 3),
    "a field gone": lambda r: r["outcomes"][0].pop("cycles"),
    "a field more": lambda r: r["outcomes"][0].update(mood=1),
    "text": lambda r: r["outcomes"][0].update(contacts="a"),
    "null": lambda r: r["outcomes"][0].update(contacts=None),
    "NaN": lambda r: r["outcomes"][0].update(seconds=float("nan")),
    "huge": lambda r: r["outcomes"][0].update(contacts=10**400),
    "in a list": lambda r: r["outcomes"][0].update(lead_s=[float("inf")]),
    "in a map": lambda r: r["outcomes"][0].update(touch_speeds_m_s={"head": 1e300}),
    "variant": lambda r: r["outcomes"][0].update(variant=["iso"]),
    "prediction gone": lambda r: r["predictions"].pop(),
    "prediction": lambda r: r["predictions"][0].update(true_positive=0.5),
    "check": lambda r: r["checks"][0].pop("disagreement"),
    "check of another": lambda r: r["checks"][0].update(index=1),
    "check of a list": lambda r: r["checks"][0].update(variant=["iso"]),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_rows_of_something_else_are_not(damage):
    told = rows()
    damage(told)
    assert not are_of(told, EPISODES, VARIANTS)


def test_a_block_of_something_else_with_a_correct_checksum_is_run_again(tmp_path, caplog):
    plan = SimulationPlan(
        config=Path(), predictors=("a",), motions=("x", "y"), episodes=4, checked=frozenset()
    )
    store = Store(tmp_path, {}, resume=False)
    store.add("0/0/0", rows())  # episodes 0 and 2
    store.add("0/1/0", {"other": []})
    again = Store(tmp_path, {}, resume=True)
    assert [block.key for block in _todo(plan, again, VARIANTS)] == ["0/1/0"]
    assert list(again.done) == ["0/0/0"]
    assert "block 0/1/0 holds something other than its episodes (1 in all)" in caplog.text
