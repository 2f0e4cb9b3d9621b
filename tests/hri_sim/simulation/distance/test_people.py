"""Activities and trackers of a measured distance: by name, by file, and what is missing."""

from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError, RecordingError
from hri_sim.simulation.distance.people import (
    ACTIVITIES,
    FULL,
    SETS,
    SIGHTS,
    Activity,
    activities,
    pack,
    sights,
)
from hri_sim.simulation.distance.run import _sets_table
from hri_sim.simulation.distance.work import Case, joints_seen
from hri_sim.simulation.motion import load_motion

SIMULATED = [each for each in ACTIVITIES.values() if not each.is_recorded]


@pytest.mark.parametrize("activity", SIMULATED, ids=lambda each: each.name)
def test_simulated_people_stay_off_the_robot_for_as_long_as_they_are_watched(activity):
    motion = load_motion(activity.motion, 30.0)
    middle = np.nanmean(np.nanmean(motion.positions[..., :2], axis=1), axis=0)
    assert abs(middle[0]) < 0.2  # an arm that reaches out moves it by centimetres
    assert motion.duration_s > 8.0


def test_without_the_data_pack_recorded_people_are_left_out_and_told():
    found, (line,) = activities(["window", "talking"], None)
    assert [each.name for each in found] == ["talking"]
    assert "window" in line
    assert "--data" in line
    assert "reaching" in line
    with pytest.raises(ConfigError, match=r"for tools is not in.*passing, talking, reaching"):
        activities(["tools"], None)


def test_a_folder_that_is_not_the_data_pack_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="not the data pack"):
        pack(tmp_path)


def test_a_recording_of_the_users_own_is_an_activity(recording):
    own = np.load(recording)
    longer = recording.with_name("longer.npz")
    np.savez(longer, positions=np.concatenate([own["positions"]] * 2), fps=own["fps"])
    (found,), lines = activities([str(longer)], None)
    assert (found.name, found.motion, lines) == ("longer", str(longer), [])
    with pytest.raises(ConfigError, match="no such recording"):
        activities([str(recording.with_name("none.npz"))], None)


def test_a_set_is_all_its_recordings_that_are_long_enough(recording, tmp_path):
    own = np.load(recording)
    folder = tmp_path / SETS["arms"]
    folder.mkdir(parents=True)
    for name, times in (("b", 2), ("a", 2), ("short", 1)):
        positions = np.concatenate([own["positions"]] * times)
        np.savez(folder / f"{name}.npz", positions=positions, fps=own["fps"])
    found, lines = activities(["arms"], tmp_path)
    assert [(each.name, each.of_set) for each in found] == [("arms/a", "arms"), ("arms/b", "arms")]
    assert found[0].absent == ACTIVITIES["seated"].absent  # legs, which nobody recorded
    assert lines == ["arms: 1 recordings left out (under 3 s, or unusable)."]
    with pytest.raises(ConfigError, match="recordings for cmu_dance is not in"):
        activities(["cmu_dance"], tmp_path)
    np.savez(folder / "c.npz", positions=positions)
    with pytest.raises(RecordingError, match=r"c\.npz: "):
        activities(["arms"], tmp_path)
    for name in "abc":
        (folder / f"{name}.npz").unlink()
    with pytest.raises(ConfigError, match=r"--activity arms: .* holds no recording .* of 3 s"):
        activities(["arms"], tmp_path)


def test_a_recording_that_ends_before_much_of_it_counts_is_refused(recording):
    with pytest.raises(
        ConfigError, match=r"lasts \d\.\d+ s, .* 2\.5 s do not count; .* 3 s or more"
    ):
        activities([str(recording)], None)


def test_trackers_are_named_sights_or_any_joint_map(tmp_path):
    found = sights(["legs-hidden", "body25"])
    assert (found[0], found[1].tracker) == (SIGHTS["legs-hidden"], "body25")
    with pytest.raises(ConfigError, match="did you mean 'coco17'"):
        sights(["coco71"])


def test_what_several_sights_hide_is_hidden_from_one_tracker():
    (both,) = sights(["coco17+legs-hidden+limbs-lost"])
    assert both.tracker == "coco17"
    assert both.hidden == SIGHTS["legs-hidden"].hidden
    assert both.lost == SIGHTS["limbs-lost"].lost
    with pytest.raises(ConfigError, match="2 joint maps; a tracker has one"):
        sights(["coco17+zed34"])
    with pytest.raises(ConfigError, match="did you mean 'legs-hidden'"):
        sights(["coco17+leg-hidden"])


def test_what_is_hidden_is_known_to_the_tracker_and_what_it_lacks_is_not():
    def joints(sight):
        case = Case(
            activity=ACTIVITIES["talking"],
            sight=SIGHTS[sight],
            noise_m=0.0,
            predictor=None,
            modes=("iso",),
        )
        able, seen = np.array(joints_seen(case)).reshape(2, -1)
        return able.sum(), seen.sum()

    assert joints("full") == (21, 21)
    assert joints("waist-hidden") == (21, 12)
    assert joints("upper-body") == (12, 12)
    assert joints("marker_clusters9") == (7, 7)
    assert joints("limbs-lost") == (21, pytest.approx(0.8 * 21))


def test_whole_sets_are_compared_by_their_worst_recording():
    def case(name):
        activity = Activity(name=f"arms/{name}", text=name, motion=name, of_set="arms")
        return Case(activity=activity, sight=FULL, noise_m=0.0, predictor=None, modes=())

    def result(*distances_m):
        pairs = zip(("predictive", "iso"), distances_m, strict=True)
        return {mode: {"distance_m": at_m} for mode, at_m in pairs}

    near, far = result(2.0, 3.0), result(None, 5.9)
    found = [(case("a"), near), (case("b"), far), (case("c"), near)]
    (table,) = _sets_table(found)
    assert table.rows == (("arms", "3", "2.00", "3.00", "+10 (b)"),)
    assert table.columns[2:4] == ("predictive, median", "iso, median")
    only = {"iso": {"distance_m": 1.0}, "fixed": {"distance_m": 1.0}}
    assert _sets_table([*found, (case("d"), only)]) == [table]  # of other modes
    assert _sets_table([(replace(case("a"), activity=ACTIVITIES["talking"]), near)]) == []
