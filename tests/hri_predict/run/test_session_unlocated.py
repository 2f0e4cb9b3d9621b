"""A whole run in which somebody is here, and no joint says where."""

from pathlib import Path

import numpy as np
import pytest

from hri_predict.cli.run import BESIDE_THE_ROBOT
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import baseline_demo

SHARED = Path(__file__).resolve().parents[4] / "shared" / "data"
needs_data = pytest.mark.skipif(not SHARED.is_dir(), reason="needs ../shared/data")


class Watch(View):
    """Keeps every tick."""

    def __init__(self):
        self.ticks = []

    def on_tick(self, tick):
        self.ticks.append(tick)


@needs_data
@pytest.mark.parametrize("located", [0, 150])
def test_somebody_who_is_here_but_nowhere_never_becomes_clear(tmp_path, located):
    """A recording whose ``world_ok`` is false throughout; and one where it is from a frame on."""
    with np.load(SHARED / "cmu_mocap" / "test" / "walking_1.npz") as file:
        arrays = dict(file)
    arrays["world_ok"] = np.arange(len(arrays["world_ok"])) < located
    path = tmp_path / "nowhere.npz"
    np.savez(path, **arrays)
    pose = {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
    source = {
        "kind": "recording", "path": str(path), "room_from_source": pose, "place": BESIDE_THE_ROBOT
    }  # fmt: skip
    demo = baseline_demo()
    watch = Watch()
    summary = run(demo.with_source(source), Options(factor=None, view=watch, until_exhausted=True))
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
