"""A recording of a process that is killed is readable up to the last second."""

import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from hri_predict.recording import open_recording, read_messages, recording_info

pytestmark = pytest.mark.realtime

# A process of its own that records scenes and tells, line by line, which it has handed over.
PROGRAM = """
import sys, time
from pathlib import Path
import numpy as np
from hri_predict.base.clock import MonotonicClock
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.recording import Recorder, RecordingInfo
from hri_predict.recording.folder.folder import Folder
from hri_predict.recording.folder.settings import RecordSettings
from hri_predict.recording.mcap.clocks import SystemClocks
from hri_predict.contracts.scene import Person, Scene

clock = MonotonicClock()
joint_map = load_joint_map("canonical")
info = RecordingInfo(joint_map=joint_map, rate_hz=25.0, declares_noise=True, config="cell")
place = Folder(Path(sys.argv[1]), "press-4", RecordSettings(folder="x", min_free_gb=0))
recorder = Recorder(place, info, threaded=True, clocks=SystemClocks(clock))
random = np.random.default_rng(0)
for k in range(10_000):
    joints = random.normal(size=(21, 3))
    person = Person(1, joints, np.ones(21, dtype=bool))
    now_ns = clock.now_ns()
    recorder.on_scene(Scene(now_ns, k, True, (person,)), now_ns)
    print(k, now_ns, flush=True)
    time.sleep(0.02)
"""


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_whoever_is_killed_loses_less_than_a_second(tmp_path: Path, seed: int) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    lines = int(60 + 100 * random.Random(seed).random())  # 1.2 to 3.2 s of recording
    for _ in range(lines):
        last = process.stdout.readline()
    process.send_signal(signal.SIGKILL)
    rest = process.stdout.read().splitlines()
    process.wait(10)
    last_k, last_ns = map(int, (rest[-1] if rest else last).split())
    (path,) = tmp_path.glob("press-4-*.mcap")
    recording = open_recording(path)
    assert "cut or damaged" in recording.note
    assert [scene.sequence for scene in recording.scenes] == list(range(len(recording.scenes)))
    lost_s = (last_ns - recording.arrival_ns[-1]) * 1e-9
    assert 0 <= lost_s < 1.0
    assert last_k - recording.scenes[-1].sequence < 50  # as many as are handed over in a second
    assert recording_info(path).has_utc
    told = list(read_messages(path, ["/scene"]))
    assert len(told) == len(recording.scenes)
    since_s = [(m.utc_ns - m.node_ns) * 1e-9 for m in told]
    assert max(since_s) - min(since_s) < 0.1  # nobody sets the clock of a test machine
