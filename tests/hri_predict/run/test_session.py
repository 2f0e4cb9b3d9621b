"""Whole runs on the virtual clock: people, node, links, controllers and arm in one process."""

from dataclasses import replace
from functools import cache
from itertools import groupby

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Region
from hri_predict.cli.run import BESIDE_THE_ROBOT, DEMO_S
from hri_predict.protocol.messages import Level, NodeState
from hri_predict.protocol.reasons import Reason
from hri_predict.recording import open_recording
from hri_predict.risk.settings import RiskSettings
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import BASELINE
from tests.shared import DATA, needs_data

ENDS_S = DEMO_S + 1.0  # the baseline's zones let the robot go on a little later than sinn's


class Watch(View):
    """Keeps every tick's advice; ``start_ns`` is the run's first tick."""

    def __init__(self):
        self.ticks = []

    def on_tick(self, tick):
        self.ticks.append(tick)

    @property
    def advice(self):
        """(time, level, reason, separation, limit) of each tick, announcements left out."""
        return [
            (t.now_ns, a.level, a.reason, a.separation_m, a.speed_limit_m_s)
            for t in self.ticks
            for a in t.advices
            if t.status.node_state not in (NodeState.STARTING, NodeState.STOPPING)
        ]

    @property
    def gave_way(self):
        """Whether the robot was slowed or stopped for somebody, not merely not released yet."""
        near = (Reason.PERSON_NEAR, Reason.PERSON_APPROACHING)
        return any(a[1] in (Level.SLOW, Level.STOP) and a[2] in near for a in self.advice)

    @property
    def levels(self):
        return [level for level, _ in groupby(self.advice, key=lambda a: a[1])]


@cache
def baseline(name):
    """A shipped configuration, which never changes, with a cheap predictor."""
    return configuration.load(configuration.shipped(name)).quiet().with_predictor(**BASELINE)


def config(name="demo.yaml", **source):
    loaded = baseline(name)
    return loaded.with_source(loaded.source.model_dump() | source) if source else loaded


def play(loaded, **options):
    watch = Watch()
    return run(loaded, Options(factor=None, view=watch, **options)), watch


@pytest.mark.long
def test_no_tick_of_the_shipped_demo_fails_with_its_network():
    """In an empty room, when the person comes, and beside the robot."""
    summary, _ = play(configuration.load(configuration.shipped("demo.yaml")), duration_s=8.0)
    assert summary.counted["scenes"] > 200
    assert not summary.counted.get("assess_failures")


def no_harm(summary):
    assert summary.contacts == 0
    assert summary.contacts_standing == 0
    assert [link["crc_errors"] for link in summary.links] == [0, 0]
    assert all(link["messages"] > 0 for link in summary.links)
    assert not summary.counted.get("assess_failures")
    assert not summary.counted.get("listener_failures")
    for controller in summary.controllers:
        assert controller["ended"] == "ok"
        assert controller["crc_errors"] == controller["counter_errors"] == 0
        assert controller["malformed"] == controller["incomplete"] == 0
        assert controller["timeouts"] == 0


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The demo, recorded: (summary, watch, path)."""
    path = tmp_path_factory.mktemp("recorded") / "a.mcap"
    return *play(config(), duration_s=ENDS_S, record=path), path


def test_the_demo_slows_stops_and_ends_clear_without_a_contact(recorded):
    summary, watch, _ = recorded
    no_harm(summary)
    assert summary.slowdowns >= 1
    assert summary.stops >= 1
    assert summary.frames_in > 300
    assert summary.predictor == "constant_velocity"
    assert summary.ticks == 25 * ENDS_S
    assert watch.levels[-1] is Level.CLEAR
    for controller in summary.controllers:
        assert controller["stops"] >= 1
        assert controller["events"][-1][2] > 0  # the robot works again


@pytest.mark.parametrize("with_links", [pytest.param(True, marks=pytest.mark.long), False])
def test_a_recording_replayed_gives_the_same_advice(recorded, with_links):
    """With mock controllers as before, or with what the controllers said while it was recorded."""
    _, first, path = recorded
    source = {"kind": "recording", "path": str(path)}
    loaded = config()
    again = loaded.with_source(
        source | {"room_from_source": loaded.source.room_from_source.model_dump()}
    )
    duration_s = None if with_links else 10.0  # the robot has stopped
    summary, second = play(again if with_links else again.without_links(), duration_s=duration_s)
    if with_links:
        no_harm(summary)
    length = min(len(first.advice), len(second.advice))
    assert length > 24 * (duration_s or ENDS_S)
    assert Level.STOP in second.levels
    assert second.advice[:length] == first.advice[:length]


def test_a_run_may_not_be_recorded_over_the_recording_it_plays(recorded):
    path = recorded[2]
    before = path.read_bytes()
    pose = {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
    source = {"kind": "recording", "path": str(path), "room_from_source": pose}
    try:
        with pytest.raises(ConfigError, match=path.name):
            play(config().with_source(source), record=path)
        assert path.read_bytes() == before
    finally:
        path.write_bytes(before)


def test_a_run_that_cannot_be_built_leaves_an_older_recording_alone(tmp_path):
    older = tmp_path / "a.mcap"
    older.write_bytes(b"worth keeping")
    loaded = config()
    slow = loaded.links[1].model_copy(update={"bitrate": 50_000})
    with pytest.raises(Exception, match="load"):
        play(replace(loaded, links=(loaded.links[0], slow)), duration_s=1, record=older)
    assert older.read_bytes() == b"worth keeping"


def test_real_hardware_has_no_virtual_time():
    loaded = config()
    real = loaded.links[0].model_copy(update={"simulate": None})
    with pytest.raises(ConfigError, match="link drive is real hardware"):
        play(replace(loaded, links=(real, loaded.links[1])), duration_s=1)


def with_risk(loaded, **changes):
    risk = RiskSettings.model_validate(loaded.node.risk.model_dump(exclude_unset=True) | changes)
    return replace(loaded, node=loaded.node.model_copy(update={"risk": risk}))


def with_button(loaded, after_s):
    """The monitor's operator acknowledges a latched stop so long after it, again and again."""
    drive, monitor = loaded.links
    simulate = monitor.simulate | {"acknowledge_after_s": after_s}
    return replace(loaded, links=(drive, monitor.model_copy(update={"simulate": simulate})))


def test_a_latched_stop_stays_until_it_is_acknowledged_over_the_wire():
    latching = with_risk(config(), latch=["stop"])
    summary, watch = play(with_button(latching, 4.0), duration_s=DEMO_S)
    no_harm(summary)
    assert Reason.LATCHED in {reason for _, _, reason, *_ in watch.advice}
    assert watch.levels[-1] is Level.CLEAR
    assert sum(c["acknowledges_sent"] for c in summary.controllers) >= 1


@pytest.mark.long
def test_a_latched_stop_that_nobody_acknowledges_stays():
    summary, watch = play(with_risk(config(), latch=["stop"]), duration_s=DEMO_S)
    no_harm(summary)
    assert watch.advice[-1][1:3] == (Level.STOP, Reason.LATCHED)
    assert summary.stops == 1


@pytest.mark.long
def test_the_demo_in_iso_mode():
    summary, watch = play(with_risk(config(), mode="iso"), duration_s=DEMO_S)
    no_harm(summary)
    assert summary.stops >= 1
    assert watch.levels[-1] is Level.CLEAR


def test_a_node_without_links_says_that_it_knows_no_robot():
    summary, watch = play(replace(config(), links=()), duration_s=1.0)
    assert summary.links == summary.controllers == []
    assert summary.contacts is None
    assert {a[1:3] for a in watch.advice} == {(Level.UNKNOWN, Reason.ROBOT_STATE_STALE)}


def beside_the_robot(path):
    """The demo with the person of a recording, who is placed beside the robot."""
    room = {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
    place = {"room_from_source": room, "place": BESIDE_THE_ROBOT}
    return config().with_source({"kind": "recording", "path": str(path)} | place)


@needs_data
@pytest.mark.parametrize("name", ["walking_1", pytest.param("soccer_1", marks=pytest.mark.long)])
def test_a_real_person_near_the_robot_is_never_touched(name):
    path = DATA / "cmu_mocap" / "test" / f"{name}.npz"
    summary, watch = play(beside_the_robot(path), until_exhausted=True)
    no_harm(summary)
    assert summary.frames_in > 300
    assert summary.min_separation_m is not None
    if name == "soccer_1":  # stays 2 m away, where a warning is enough
        assert summary.min_separation_m > 1.9
        assert Level.WARN in watch.levels
    else:
        assert watch.gave_way


@needs_data
def test_a_seated_person_without_legs_is_never_touched():
    path = DATA / "assembly" / "task1_human1_trial1.npz"
    loaded = config("assembly.yaml", path=str(path))
    summary, watch = play(loaded, duration_s=6.0)
    no_harm(summary)
    assert summary.frames_in > 90
    told = {name for t in watch.ticks if t.assessment for name in t.assessment.zones.segments}
    assert told
    assert not any(leg in name for name in told for leg in ("thigh", "shank", "foot"))


@needs_data
@pytest.mark.long
def test_a_walk_from_a_bvh_file_is_never_touched(tmp_path):
    """A walk of the data pack, its joints' places written as translations of a flat rig."""
    path = write_walk(tmp_path / "walk.bvh")
    summary, watch = play(beside_the_robot(path), until_exhausted=True)
    no_harm(summary)
    assert summary.frames_in == WALK_FRAMES
    assert watch.gave_way


WALK_FRAMES = 150


def write_walk(path):
    """A BVH of joints that carry their positions themselves (cm, y up), every second frame."""
    recording = open_recording(DATA / "cmu_mocap" / "test" / "walking_1.npz")
    names, scenes = recording.joint_map.source_joints, recording.scenes[: 2 * WALK_FRAMES : 2]
    root, *others = names
    room = np.array([scene.people[0].positions for scene in scenes])  # (F, J, 3), z up
    y_up = np.stack([room[..., 1], room[..., 2], room[..., 0]], axis=-1) * 100.0
    y_up[:, 1:] -= y_up[:, :1]  # relative to the root, which never turns
    channels = "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
    lines = ["HIERARCHY", f"ROOT {root}", "{", "OFFSET 0.0 0.0 0.0", channels]
    for name in others:
        end = ["End Site", "{", "OFFSET 0.0 1.0 0.0", "}"]
        lines += [f"JOINT {name}", "{", "OFFSET 0.0 0.0 0.0", channels, *end, "}"]
    lines += ["}", "MOTION", f"Frames: {len(scenes)}", f"Frame Time: {1 / 60}"]
    for frame in y_up:
        values = [f"{x!r} {y!r} {z!r} 0.0 0.0 0.0" for x, y, z in frame.tolist()]
        lines.append(" ".join(values))
    path.write_text("\n".join(lines) + "\n")
    return path


# -- people who vanish


def vanishing(*places):
    """The first of these people vanishes after 4 s and is never seen again."""
    script = [{"do": "wait", "seconds": 60.0}]
    people = [{"start": place, "script": script} for place in places]
    loaded = config(people=people).with_faults(["vanish@4:person=1"])
    summary, watch = play(loaded, duration_s=14.0)
    start = watch.ticks[0].now_ns
    return summary, [((a[0] - start) * 1e-9, *a[1:]) for a in watch.advice]


@pytest.mark.parametrize("others", [[], pytest.param([[4.0, 3.0]], marks=pytest.mark.long)])
def test_who_vanishes_near_the_robot_never_becomes_clear_by_ageing_out(others):
    """Whether somebody else is here all the time or nobody."""
    summary, advice = vanishing([2.0, 0.2], *others)
    after = [(level, reason) for t, level, reason, *_ in advice if t >= 4.3]
    assert len(after) > 230
    assert set(after) == {(Level.STOP, Reason.PERSON_LOST)}
    assert summary.counted["vanished"] == 1


@pytest.mark.parametrize("kind", ["exits", "entrances"])
def test_a_door_within_a_robots_reach_and_separation_is_refused(kind):
    loaded = config()
    door = {"polygon": [[1.5, 0.0], [2.5, 0.0], [2.5, 1.0], [1.5, 1.0]]}
    people = loaded.node.people.model_copy(update={kind: [Region(**door)]})
    node = loaded.node.model_copy(update={"people": people})
    with pytest.raises(ConfigError, match=rf"people.{kind}.0: \d\.\d\d m too close to robot arm"):
        play(replace(loaded, node=node), duration_s=0.1)


def test_a_room_that_is_seen_empty_becomes_clear():
    """Nobody was ever here; and: somebody left by the exit."""
    summary, watch = play(config(people=[]), duration_s=5.0)
    assert watch.levels[-1] is Level.CLEAR
    assert summary.slowdowns == summary.stops == 0
    leaves = [{
        "start": [2.6, 1.8], "repeat": False,
        "script": [{"do": "walk", "to": [4.5, 3.4]}, {"do": "leave", "seconds": 60.0}],
    }]  # fmt: skip
    _, watch = play(config(people=leaves), duration_s=12.0)
    assert watch.levels[-1] is Level.CLEAR
    assert set(watch.levels) - {Level.CLEAR, Level.UNKNOWN}  # it was not clear all the time


def test_a_room_that_is_not_seen_is_never_clear():
    _, watch = play(config(people=[]).with_faults(["blind@2+2"]), duration_s=8.0)
    start = watch.ticks[0].now_ns
    blind = [a for a in watch.advice if 2.1e9 <= a[0] - start < 4.0e9]
    assert {a[1] for a in blind} == {Level.UNKNOWN}
    assert watch.levels[-1] is Level.CLEAR


@needs_data
@pytest.mark.parametrize("located", [0, 150])
def test_somebody_who_is_here_but_nowhere_never_becomes_clear(tmp_path, located):
    """A recording whose ``world_ok`` is false throughout; and one where it is from a frame on."""
    with np.load(DATA / "cmu_mocap" / "test" / "walking_1.npz") as file:
        arrays = dict(file)
    arrays["world_ok"] = np.arange(len(arrays["world_ok"])) < located
    path = tmp_path / "nowhere.npz"
    np.savez(path, **arrays)
    summary, watch = play(beside_the_robot(path), until_exhausted=True)
    assert summary.contacts == summary.contacts_standing == 0
    assert not summary.counted.get("assess_failures")
    from_ns = watch.ticks[0].now_ns + located / 120 * 1e9
    heard = [(a.level, a.reason) for t in watch.ticks if t.now_ns >= from_ns for a in t.advices]
    assert len(heard) > 40
    assert Level.CLEAR not in {level for level, _ in heard}
    if not located:
        assert summary.counted["unlocated_people"] > 300
        assert {level for level, _ in heard} == {Level.UNKNOWN}
        assert heard.count((Level.UNKNOWN, Reason.PERSON_NOT_LOCATED)) > 40
