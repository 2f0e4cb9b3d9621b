"""Every command of the README runs, in an empty folder, with what the README tells to put there."""

import json
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hri_drivers.scene_codec import SEES_ROOM, open_datagram
from hri_predict.cli.check import examine
from hri_predict.config import load
from hri_predict.predictors.base import checked
from hri_predict.risk.robot_file import read_robot_file

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared" / "data"
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = [
    line.removeprefix("$ ")
    for block in re.findall(r"```console\n(.*?)```", README, re.DOTALL)
    for line in block.splitlines()
]
SENDER = ROOT / "drivers" / "python" / "hri_sender.py"
RUN_BY_CI = {"make demo", "make test"}  # .ci/run runs both, from a clean clone
RECORDINGS = {
    "walking_1.npz": SHARED / "cmu_mocap" / "test" / "walking_1.npz",
    "walking_2.npz": SHARED / "cmu_mocap" / "train" / "walking_2.npz",
    "task1_human1_trial1.npz": SHARED / "assembly" / "task1_human1_trial1.npz",
}
MINE = ("walking_2", "walking_3", "soccer_1", "basketball_1", "jumping_1")
"""Of the data pack's training recordings, what stands for the user's own folder."""
OTHERS = ("walking_1", "walking_extra_7")
"""Of its test recordings, what stands for those that were not used."""
ARM_URDF = """<robot name="arm">
  <link name="base_link"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <joint name="turn" type="revolute">
    <parent link="base_link"/><child link="tool0"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="2" effort="1"/>
  </joint>
  <link name="tool0"><collision><geometry><box size="0.1 0.1 1"/></geometry></collision></link>
</robot>
"""


@pytest.fixture
def folder(tmp_path):
    """What the README tells to save, with devices that this machine has."""
    master, slave = os.openpty()
    cell = re.search(r"```yaml\n# cell.yaml\n(.*?)```", README, re.DOTALL)
    assert cell
    text = cell[1].replace("/dev/ttyUSB0", os.ttyname(slave))
    text = text.replace("interface: socketcan", "interface: virtual")
    (tmp_path / "cell.yaml").write_text(text, encoding="utf-8")
    for name, path in RECORDINGS.items():
        if path.exists():
            (tmp_path / name).symlink_to(path)
    for own, split, names in (
        ("recordings", "train", MINE),
        ("other_recordings", "test", OTHERS),
    ):
        (tmp_path / own).mkdir()
        for name in names:
            (tmp_path / own / f"{name}.npz").symlink_to(
                SHARED / "cmu_mocap" / split / f"{name}.npz"
            )
    (tmp_path / "arm.urdf").write_text(ARM_URDF, encoding="utf-8")
    yield tmp_path
    os.close(master)
    os.close(slave)


def test_the_readme_has_the_two_commands_first():
    assert COMMANDS[:2] == ["make demo", "make test"]


def test_ci_runs_the_two_commands():
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert all(command in ci for command in RUN_BY_CI)


@pytest.mark.parametrize("command", [c for c in COMMANDS if c not in RUN_BY_CI], ids=str)
def test_command(command, folder):
    words = shlex.split(command.replace("can:socketcan:can0", "can:virtual:readme"))
    module = "hri_predict"
    if words[:2] == ["python", "-m"]:
        pytest.importorskip("pinocchio", reason="needs pin, as the README says")
        module, words = words[2], words[2:]
    else:
        assert words[0] == "hri-predict"
    for name, path in RECORDINGS.items():
        if name in command and not path.exists():
            pytest.skip(f"needs ../shared/data for {name}")
    if re.search(r"--data (other_)?recordings", command) and not SHARED.exists():
        pytest.skip("needs ../shared/data for recordings")
    if words[1] == "train":  # an hour's work, done for a moment
        words += ["--set", "train.epochs=1", "--set", "train.windows_per_epoch=64"]
    if words[1] in ("listen", "fleet"):
        words += ["--seconds", "1"]
    if words[:3] == ["hri-predict", "replay", "monday.mcap"]:  # which an earlier command records
        record = ["run", "cell.yaml", "--shadow", "--record", "monday.mcap", "--duration", "3"]
        subprocess.run([sys.executable, "-m", "hri_predict", *record], cwd=folder, check=True)
    if "--calibration" in words:  # which an earlier command makes
        make = ["calibrate", "--predictor", "constant_velocity", "--data", "recordings"]
        make += ["--out", "mine.calibration.json"]
        subprocess.run([sys.executable, "-m", "hri_predict", *make], cwd=folder, check=True)
    daemon = words[1] == "run" and "--duration" not in words
    sender = None
    if "live_udp.yaml" in words and words[1] == "run":
        sender = subprocess.Popen([sys.executable, SENDER, "--seconds", "120"], cwd=folder)
    process = subprocess.Popen(
        [sys.executable, "-m", module, *words[1:]],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    if daemon:  # it is up when it has alerted somebody
        end = time.monotonic() + 120
        while not (folder / "alerts.jsonl").exists() and process.poll() is None:
            assert time.monotonic() < end, "no alert"
            time.sleep(0.1)
        time.sleep(1.0)
        process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=150)
    if sender is not None:
        sender.kill()
        sender.wait()
        assert int(re.findall(r"scenes *│ *(\d+)", out)[0]) > 10
    assert process.returncode == 0, err
    assert "Traceback" not in err
    assert "were calibrated on" not in err
    if daemon:
        assert "Summary" in out
    if "--out" in words and module != "hri_predict":
        assert read_robot_file(words[words.index("--out") + 1], folder).joints
    if "--record" in words:
        assert (folder / words[words.index("--record") + 1]).stat().st_size > 1000


def test_an_unknown_fault_lists_those_there_are(folder):
    assert "`hri-predict demo --fault nothing`" in README
    command = [sys.executable, "-m", "hri_predict", "demo", "--fault", "nothing"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "vanish" in done.stderr
    assert "bit_errors" in done.stderr


def test_the_controllers_that_stand_in_for_hardware_are_valid(folder):
    block = re.search(r"```yaml\n(links:\n(?:  .*\n)*?.*simulate: (?:.*\n)*?)```", README)
    assert block
    cell = (folder / "cell.yaml").read_text(encoding="utf-8")
    before, _, after = re.split(r"(links:\n(?:  .*\n)+)", cell)
    assert "socketcan" not in before + after
    (folder / "cell.yaml").write_text(before + block[1] + after, encoding="utf-8")
    found = examine(load(folder / "cell.yaml"))
    assert [link["name"] for link in found["links"]] == ["plc", "drive"]
    assert "simulated links: mock controllers, no hardware" in found["notes"]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_memory_stays_flat(folder):
    """A fifth of the hour that the README's command takes; half of it is warming up."""
    assert "`hri-predict bench memory`" in README
    command = [sys.executable, "-m", "hri_predict", "bench", "memory", "--hours", "0.2", "--json"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["growth_percent"] < 5


def test_the_predictor_that_the_readme_shows_keeps_the_contract():
    code = re.search(r"```python\n# my_package.py\n(.*?)```", README, re.DOTALL)
    assert code
    names: dict[str, Any] = {}
    exec(code[1], names)
    mine = names["Mine"](names["Mine"].settings_model(name="mine", horizon_s=0.4))
    history = np.random.default_rng(0).normal(size=(2, mine.history_steps, 21, 3))
    forecast = mine.predict(history, np.ones(history.shape[:3], bool))
    checked(forecast, 2, mine)
    np.testing.assert_array_equal(forecast.positions[:, -1], history[:, -1])


def test_the_tracker_that_the_readme_shows_is_heard(monkeypatch):
    code = re.search(r"```python\n# tracker.py\n(.*?)```", README, re.DOTALL)
    assert code
    monkeypatch.syspath_prepend(SENDER.parent)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as node:
        node.bind(("127.0.0.1", 0))
        node.settimeout(20)
        names: dict[str, Any] = {}
        exec(code[1].replace("47800", str(node.getsockname()[1])), names)
        headers = [open_datagram(node.recv(2000))[0] for _ in range(3)]
        names["sender"].close()
    assert [(h.sequence, h.people, h.flags & SEES_ROOM) for h in headers] == [
        (0, 1, 1), (1, 0, 1), (2, 0, 0),
    ]  # fmt: skip


def test_the_readme_names_only_files_that_are_there():
    links = re.findall(r"\]\(([^)#]+)\)", README)
    assert len(links) > 10
    for link in links:
        assert (ROOT / link).exists(), link
