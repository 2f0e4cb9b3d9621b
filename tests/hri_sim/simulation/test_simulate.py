"""Simulations: every approach once, the same for the same seed, and resumed without a trace."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.contracts import registry
from hri_predict.run import config as configuration
from hri_predict.zones.calibration import shipped_calibration
from hri_sim.simulation import _decided_by, _plan, _reads, report, simulate
from hri_sim.simulation.request import SimulationRequest
from hri_sim.simulation.work import BLOCK, SimulationPlan, blocks, episodes
from tests.hri_predict.base.machine.dask_processes import scheduler, worker


def plan(motions, count):
    return SimulationPlan(
        config=Path(),
        predictors=("a", "b"),
        motions=tuple(map(str, range(motions))),
        episodes=count,
        checked=frozenset(),
    )


@pytest.mark.parametrize(("motions", "count"), [(3, 100), (24, 10), (1, 2 * BLOCK + 1), (5, 5)])
def test_blocks_hold_every_episode_of_every_predictor_once(motions, count):
    made = plan(motions, count)
    for predictor in (0, 1):
        mine = [e for b in blocks(made) if b.predictor == predictor for e in episodes(made, b)]
        assert sorted(mine) == list(range(count))
    assert all(0 < len(episodes(made, block)) <= BLOCK for block in blocks(made))
    assert len({block.key for block in blocks(made)}) == len(blocks(made))


@pytest.fixture
def request_of(recording, tmp_path):
    """A request of two approaches, of two short recordings."""
    other = tmp_path / "others.npz"
    other.write_bytes(recording.read_bytes())
    base = SimulationRequest(
        config=configuration.shipped("simulate.yaml"),
        predictors=("constant_velocity",),
        modes=("iso",),
        motions=(str(recording), str(other)),
        episodes=2,
    )
    return lambda **more: replace(base, **more)


def text(result):
    return report(result, None).json


def test_changed_code_of_a_predictor_is_another_simulation(request_of, monkeypatch):
    plan = _plan(request_of())
    before = _decided_by(plan)
    assert _decided_by(plan) == before
    monkeypatch.setattr(registry, "code_of", lambda settings: "1a")
    assert _decided_by(plan) != before


@pytest.fixture
def own_cell(tmp_path):
    """The shipped cell with its own copies of the robot and of the path that it follows."""
    text = configuration.shipped("simulate.yaml").read_text(encoding="utf-8")
    for folder, name in (("robots", "ur5e"), ("trajectories", "pick_and_place")):
        copy = tmp_path / f"{name}.yaml"
        copy.write_bytes(data_path(folder, f"{name}.yaml").read_bytes())
        text = text.replace(f": {name}\n", f": {copy.name}\n")
        text = text.replace(f": {name}}}", f": {copy.name}}}")
    path = tmp_path / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("changed", ["ur5e.yaml", "pick_and_place.yaml", "arms.npz"])
def test_another_content_of_a_file_is_another_simulation(request_of, own_cell, changed):
    """A resumed run and the workers of a cluster must have the same files."""
    plan = _plan(request_of(config=own_cell))
    before, read = _decided_by(plan), _reads(plan)
    assert len(read) == len(set(read))
    assert all(path.is_file() for path in read)
    path = own_cell.parent / changed
    assert path in read
    with path.open("ab") as file:
        file.write(b"\n")
    assert _decided_by(plan) != before


def test_files_of_the_installation_are_not_compared_by_their_place(request_of):
    (_, *others) = _reads(_plan(request_of()))  # the shipped configuration is read by its path
    assert sorted(path.name for path in others) == ["arms.npz", "others.npz"]


@pytest.mark.long
def test_a_simulation_reproduces_and_resumes_to_the_same_table(request_of, tmp_path):
    said, out = [], tmp_path / "out"
    whole = simulate(request_of(out=out), lambda done, total: said.append((done, total)))
    assert said == [(0, 2), (1, 2), (2, 2)]
    assert whole.checks == 2
    assert whole.disagreements == []
    path = out / "episodes.jsonl"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:2]) + "\n")  # as if it had been ended after one block
    said.clear()
    resumed = simulate(
        request_of(out=out, resume=True), lambda done, total: said.append((done, total))
    )
    assert said == [(1, 2), (2, 2)]
    assert text(resumed) == text(whole)
    assert text(simulate(request_of(), lambda *_: None)) == text(whole)
    other = simulate(request_of(seed=1), lambda *_: None)
    assert text(other) != text(whole)


@pytest.mark.long
def test_a_tracker_with_noise_changes_what_is_seen_in_both_ways_of_running(request_of):
    walk = {"motions": ("procedural:0",), "episodes": 1}
    exact = simulate(request_of(**walk), lambda *_: None)
    tracked = request_of(tracker="coco17", noise_m=0.02, wander_m=0.01, **walk)
    seen = simulate(tracked, lambda *_: None)
    assert seen.checks == 1  # the episode again through the whole node
    assert seen.disagreements == []
    assert [r.outcomes for r in seen.results] != [r.outcomes for r in exact.results]
    assert "tracker coco17; noise_m 0.02; wander_m 0.01" in report(seen, None).notes[-1]


@pytest.mark.long
@pytest.mark.parametrize(
    "seen",
    [{"hidden": ("l_elbow", "l_wrist", "l_hand")}, {"lost_limbs": 0.4}],
    ids=["an arm is hidden", "limbs get lost"],
)
def test_hidden_limbs_change_what_is_seen_in_both_ways_of_running(request_of, seen):
    walk = {"motions": ("procedural:0",), "episodes": 1}
    whole = simulate(request_of(**walk), lambda *_: None)
    half = simulate(request_of(**seen, **walk), lambda *_: None)
    assert half.checks == 1
    assert half.disagreements == []
    assert [r.outcomes for r in half.results] != [r.outcomes for r in whole.results]


@pytest.fixture
def glimpse(tmp_path):
    """A recording of two thirds of a second, which is too short for an approach."""
    path = tmp_path / "glimpse.npz"
    np.savez(path, positions=np.ones((20, 6, 3), np.float32), fps=np.float32(30))
    return str(path)


@pytest.mark.long
def test_a_recording_that_is_too_short_is_left_out_and_told(request_of, glimpse, caplog):
    motions = (glimpse, *request_of().motions)
    told = report(simulate(request_of(motions=motions), lambda *_: None), None)
    data = json.loads(told.json)
    assert len(data["asked"]["recordings"]) == 2
    (line,) = data["left_out"]
    assert line.startswith("recording glimpse: too short")
    assert f"Left out: {line}." in told.notes
    assert "Recordings left out: 1." in told.notes
    assert f"recording {glimpse}: too short" in caplog.text


def test_a_recording_of_which_the_tracker_sees_nothing_is_left_out(request_of, tmp_path):
    """Nobody would be there for the node, so the table would be about no tracker at all."""
    (tmp_path / "feet.yaml").write_text(
        "name: feet\nreference: none\nunits: m\naxes: [x, y, z]\n"
        "joints: [left, right]\nmap: {l_foot: left, r_foot: right}\n"
    )
    arms = np.zeros((60, 6, 3), np.float32) + np.array([0.1, 0.2, 1.2], np.float32)
    np.savez(tmp_path / "arms.npz", positions=arms, fps=np.float32(30))
    asked = request_of(motions=(str(tmp_path / "arms.npz"),), tracker=str(tmp_path / "feet.yaml"))
    with pytest.raises(ConfigError, match=r"arms.*: tracker .*feet\.yaml sees none of its joints"):
        simulate(asked, lambda *_: None)


def test_a_recording_of_unknown_joints_and_a_slow_one_are_left_out(request_of, tmp_path, caplog):
    rows = "".join(f"{0.4 * k:.1f},0,0,1,0,0,2\n" for k in range(60))
    for name, joints in (("slow", ("l_wrist", "r_wrist")), ("odd", ("P1", "P2"))):
        columns = ",".join(f"{joint}_{axis}" for joint in joints for axis in "xyz")
        (tmp_path / f"{name}.csv").write_text(f"time_s,{columns}\n{rows}", encoding="utf-8")
    asked = request_of(motions=(str(tmp_path / "slow.csv"), str(tmp_path / "odd.csv")))
    with pytest.raises(ConfigError, match=r"no recording is left: recording slow: 2\.5 captures"):
        simulate(asked, lambda *_: None)
    assert "odd.csv: no joint matches" in caplog.text


def test_a_run_of_which_no_recording_is_left_is_refused(request_of, glimpse):
    with pytest.raises(
        ConfigError, match=r"no recording is left: .*glimpse.*; give others"
    ) as told:
        simulate(request_of(motions=(glimpse,)), lambda *_: None)
    assert "\n" not in str(told.value)


@pytest.mark.long
def test_two_recordings_of_one_name_in_two_folders_are_two(request_of, tmp_path):
    first, _ = request_of().motions
    (tmp_path / "second").mkdir()
    again = tmp_path / "second" / Path(first).name
    again.write_bytes(Path(first).read_bytes())
    data = json.loads(text(simulate(request_of(motions=(first, str(again))), lambda *_: None)))
    assert len(set(data["asked"]["recordings"])) == 2
    assert set(data["results"][0]["by_recording"]) == set(data["asked"]["recordings"])


def test_unknown_modes_and_coverages_are_refused_before_anything_starts(request_of, tmp_path):
    for change in ({"modes": ("iso9",)}, {"modes": (), "coverages": (0.5,)}):
        with pytest.raises(ConfigError, match="--mode") as error:
            simulate(request_of(out=tmp_path / "out", **change), lambda *_: None)
        assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_a_configuration_without_a_closed_loop_is_refused(request_of):
    with pytest.raises(ConfigError, match="needs 'approach'"):
        simulate(request_of(config=configuration.shipped("demo.yaml")), lambda *_: None)


@pytest.mark.realtime
@pytest.mark.long
def test_two_processes_give_the_same_table_as_one(request_of):
    alone = text(simulate(request_of(jobs=1), lambda *_: None))
    assert text(simulate(request_of(jobs=2), lambda *_: None)) == alone


@pytest.mark.realtime
@pytest.mark.long
def test_two_workers_of_a_cluster_give_the_same_table_as_this_process(request_of, tmp_path):
    pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    alone = text(simulate(request_of(jobs=1), lambda *_: None))
    with scheduler(tmp_path) as address, worker(address, tmp_path / "a"):  # noqa: SIM117
        with worker(address, tmp_path / "b"):
            assert text(simulate(request_of(cluster=address), lambda *_: None)) == alone


def test_a_calibration_is_used_by_the_predictor_that_it_was_made_for(tmp_path):
    file = tmp_path / "mine.json"
    file.write_bytes(shipped_calibration("constant_velocity").read_bytes())
    path = configuration.shipped("simulate.yaml")
    made = replace(plan(1, 1), config=path, calibrations=(file,))
    used = made.loaded("constant_velocity").node.risk.coverage.calibration
    assert used == str(file)
    assert made.loaded("zero_velocity").node.risk.coverage.calibration is None
