"""Whole runs with a COCO tracker: no hands, feet, torso and crown."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level, NodeState, Zone
from hri_predict.recording.formats.csv_table import write_csv
from hri_predict.recording.recording import recording_of_one
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.people.body import Body
from tests.hri_predict.people.test_inferring import sent

RATE_HZ, SECONDS = 30.0, 6.0


class Watch(View):
    """Keeps every tick."""

    def __init__(self) -> None:
        self.ticks: list[Tick] = []

    def on_tick(self, tick: Tick) -> None:
        """Keep it."""
        self.ticks.append(tick)


@pytest.fixture(scope="module")
def walk(tmp_path_factory) -> Path:
    """A COCO tracker's file: somebody glides from 4.5 m to 1.5 m from the arm; 2 cm noise."""
    rng = np.random.default_rng(5)
    who, frames = Body(1.75), round(RATE_HZ * SECONDS)
    at = 4.5 - np.minimum(np.arange(frames) / RATE_HZ, 3.0)
    bodies = [who.joints(who.standing(np.array([x, 0.2]), np.pi)) for x in at]
    raw = np.array([sent(body).positions for body in bodies])
    raw += rng.normal(0, 0.02, raw.shape)
    coco = load_joint_map("coco17")
    path = tmp_path_factory.mktemp("coco") / "walk.csv"
    # the map's own axes are a camera's; the file is in the room's
    room = load_joint_map("canonical")
    one = recording_of_one(
        path=path,
        kind="csv",
        joint_map=replace(room, source_joints=coco.source_joints),
        raw=raw,
        rate_hz=RATE_HZ,
        person=1,
    )
    write_csv(path, one)
    return path


@pytest.fixture(scope="module")
def ticks(walk) -> list[Tick]:
    return play(walk)


def play(walk, record=None, predictor="sinn"):
    loaded = configuration.load(configuration.shipped("demo.yaml")).quiet()
    loaded = loaded.with_source({"kind": "recording", "path": str(walk), "room_from_source": {}})
    watch = Watch()
    run(
        loaded.with_predictor(predictor),
        Options(factor=None, until_exhausted=True, view=watch, record=record),
    )
    return [t for t in watch.ticks if t.status.node_state is not NodeState.STOPPING]


def test_a_coco_person_is_followed_to_the_end(ticks):
    with_people = [tick for tick in ticks if tick.snapshot is not None and tick.snapshot.ids]
    assert len(with_people) > 100
    snapshot = with_people[-1].snapshot
    hand = JOINTS.index("l_hand")
    assert snapshot.observed[0, -1, hand]
    assert not snapshot.measured[0, -1, hand]
    assert 0.08 < snapshot.inferred.within_m[0, hand] < 0.2
    # near the arm the robot is not let go on
    assert with_people[-1].advices[0].level in (Level.SLOW, Level.STOP, Level.UNKNOWN)


def test_its_zones_on_the_wire_have_a_tight_thorax(ticks):
    zones = [m for tick in ticks for m in tick.messages if isinstance(m, Zone) and m.step == 0]
    thorax = CANONICAL.segment_names.index("thorax")
    radii = [c.radius for zone in zones for c in zone.capsules if c.segment == thorax]
    assert len(radii) > 100
    # 0.215 m, and a quarter of a trunk; noise of 2 cm at each end of it
    assert 0.3 < np.median(radii) < 0.38
