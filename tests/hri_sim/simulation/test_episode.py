"""An episode of played bodies is the episode of the whole node; and what protection changes."""

import dataclasses
import itertools

import pytest

from hri_predict.protocol.messages import Level
from hri_predict.risk.settings import RISK_MODES
from hri_predict.run.working_distance import seen
from hri_sim.simulation.approach import lasts_ns, over_floor
from hri_sim.simulation.bodies import compute, joined, moved
from hri_sim.simulation.cell import Cell, variants
from hri_sim.simulation.episode import _Watch, run_episode
from hri_sim.simulation.motion import load_motion
from hri_sim.simulation.results.outcome import Truth, outcome, prediction
from hri_sim.simulation.scenario import draw
from hri_sim.simulation.whole_node import disagreement


def episode(cell, names, index, risk_modes=("predictive", "iso")):
    modes = variants(cell.config, risk_modes, [])
    motions = [load_motion(name, 30.0) for name in names]
    scenario = draw(seed=0, index=index, motions=motions, workspace=cell.workspace, lead_in_s=3.0)
    bodies = joined(
        [
            moved(
                compute(cell=cell, motions=[name], lead_in_s=scenario.lead_in_s, variants=modes),
                over_floor(place),
                p,
            )
            for p, (name, place) in enumerate(zip(names, scenario.places, strict=True))
        ],
        lasts_ns(motions, scenario.lead_in_s),
    )
    return modes, scenario, bodies


@pytest.mark.long
@pytest.mark.parametrize(
    ("names", "index"), [(["procedural:1"], 0), (["procedural:2", "procedural:3"], 1)]
)
def test_it_agrees_with_the_whole_node(cell, names, index):
    modes, scenario, bodies = episode(cell, names, index)
    for variant in modes[: 3 - len(names)]:
        log = run_episode(cell=cell, scenario=scenario, variant=variant, bodies=bodies)
        assert disagreement(cell, scenario, variant, log) == ""
        assert log.controllers[0].counter_errors > 0  # messages were lost, the same ones


@pytest.mark.long
def test_with_a_tick_for_each_capture_it_agrees_too(cell):
    node = cell.config.node.model_copy(update={"ticks": "capture"})
    capture = Cell(dataclasses.replace(cell.config, node=node))
    modes, scenario, bodies = episode(capture, ["procedural:1"], 0)
    stamps = [snapshot.now_ns for snapshot in bodies.snapshots]
    assert {b - a for a, b in itertools.pairwise(stamps)} - {40_000_000}  # not the fixed rate
    log = run_episode(cell=capture, scenario=scenario, variant=modes[0], bodies=bodies)
    assert disagreement(capture, scenario, modes[0], log) == ""


@pytest.mark.long
def test_batched_and_single_forecasts_give_the_same_advice_in_each_mode(cell, monkeypatch):
    cell = Cell(cell.config.with_predictor("mixer", horizon_s=1.2))
    advices, record = [], _Watch.on_tick

    def on_tick(self, tick):
        record(self, tick)
        advices.extend(tick.advices)

    monkeypatch.setattr(_Watch, "on_tick", on_tick)
    logs = []
    for batch in (seen.BATCH, 1):
        monkeypatch.setattr(seen, "BATCH", batch)
        modes, scenario, bodies = episode(cell, ["procedural:1"], 0, RISK_MODES)
        logs += [run_episode(cell=cell, scenario=scenario, variant=v, bodies=bodies) for v in modes]
    half = len(advices) // 2
    for mine, single in zip(advices[:half], advices[half:], strict=True):
        assert (mine.level, mine.reason) == (single.level, single.reason)
        assert mine.speed_limit_m_s == pytest.approx(single.speed_limit_m_s, abs=1e-3)
    assert {advice.level for advice in advices} >= {Level.CLEAR, Level.SLOW, Level.STOP}
    half = len(logs) // 2
    for mine, single in zip(logs[:half], logs[half:], strict=True):
        assert (mine.contacts, mine.levels) == (single.contacts, single.levels)
        assert mine.controllers[0].stops == single.controllers[0].stops
        assert mine.min_separation_m == pytest.approx(single.min_separation_m, abs=1e-3)


@pytest.fixture(scope="module")
def one_person(cell):
    """(variants, scenario, bodies, log of the first variant) with one person."""
    modes, scenario, bodies = episode(cell, ["procedural:1"], 0)
    return (
        modes,
        scenario,
        bodies,
        run_episode(cell=cell, scenario=scenario, variant=modes[0], bodies=bodies),
    )


@pytest.mark.long
def test_a_disagreement_is_told(cell, one_person):
    """And nothing else is: in all the rest both runs agree."""
    modes, scenario, _, log = one_person
    assert log.min_separation_m is not None
    report = log.controllers[0]
    stops = [(t, cause, limit) for t, cause, limit in report.events if limit == 0]
    assert stops
    late = [(t + 0.2, cause, limit) for t, cause, limit in stops]
    wrong = dataclasses.replace(
        log,
        contacts=log.contacts + 1,
        min_separation_m=log.min_separation_m + 0.02,
        controllers=[dataclasses.replace(report, events=late)],
    )
    said = disagreement(cell, scenario, modes[0], wrong).split("; ")
    assert [line.split()[0] for line in said] == ["contacts", "stops", "smallest"]


@pytest.mark.long
def test_alone_the_robot_works_as_in_an_empty_cell_and_protection_costs_work(cell, one_person):
    modes, scenario, bodies, protected = one_person
    alone = run_episode(cell=cell, scenario=scenario, variant=modes[0], bodies=bodies, nobody=True)
    truth = Truth.of(alone, cell.models)
    without = outcome(cell=cell, scenario=scenario, log=alone, alone=alone, truth=truth)
    found = outcome(cell=cell, scenario=scenario, log=protected, alone=alone, truth=truth)
    assert without.cycles == without.cycles_empty > 0
    assert without.stops == 0
    # once it is at speed, time is time along the path
    assert alone.path_s["arm"][-1] - alone.path_s["arm"][-101] == pytest.approx(4.0, abs=0.1)
    assert found.contacts == 0
    assert found.cycles < without.cycles
    instants = prediction(cell=cell, scenario=scenario, alone=alone, truth=truth, bodies=bodies)
    total = instants.true_positive + instants.false_positive
    total += instants.false_negative + instants.true_negative
    assert total == pytest.approx((found.seconds - 1.0) * 5, abs=1)


@pytest.mark.long
def test_the_same_seed_loses_the_same_messages_and_another_others(cell, one_person):
    modes, scenario, bodies, log = one_person
    one, again = (
        log.controllers[0],
        run_episode(cell=cell, scenario=scenario, variant=modes[0], bodies=bodies).controllers[0],
    )
    other = dataclasses.replace(scenario, link_seed=scenario.link_seed + 1)
    assert one == again
    assert (
        run_episode(cell=cell, scenario=other, variant=modes[0], bodies=bodies).controllers[0]
        != one
    )
