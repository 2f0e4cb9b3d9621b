"""A latch outlives the node's process."""

import json
import signal
import subprocess
import sys
import time

import pytest
import yaml

from hri_predict.run import config as configuration

pytestmark = [pytest.mark.realtime, pytest.mark.long]


def latched(path):
    try:
        return json.loads(path.read_bytes())["parts"]["latches"]["robots"]["arm"]
    except (OSError, KeyError):
        return {"causes": []}


def test_a_node_that_is_killed_while_latched_is_latched_again(tmp_path):
    data = yaml.safe_load(configuration.shipped("demo.yaml").read_text(encoding="utf-8"))
    data["predictor"] = {"name": "constant_velocity"}
    data["risk"] = {"mode": "iso", "latch": ["start", "restart"]}
    data["state"] = "state.json"
    data["alerts"] = {"terminal": False}
    config, state = tmp_path / "cell.yaml", tmp_path / "state.json"
    config.write_text(yaml.safe_dump(data), encoding="utf-8")
    command = [sys.executable, "-m", "hri_predict", "run", str(config), "--json"]
    node = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)
    try:
        end_s = time.monotonic() + 60.0
        while not latched(state)["causes"] and time.monotonic() < end_s:
            time.sleep(0.05)
    finally:
        node.send_signal(signal.SIGKILL)
        node.wait()
    assert latched(state)["causes"] == ["start", "restart"]  # a first start is as a restart
    again = subprocess.run([*command, "--duration", "3"], capture_output=True, check=True)
    after = latched(state)
    assert after["causes"] == ["start", "restart"]
    assert not json.loads(again.stdout)["ticks_at"].get("clear")
