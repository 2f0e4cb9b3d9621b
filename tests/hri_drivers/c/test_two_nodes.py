"""Two nodes with the same ids on one bus: no receiver moves the robot while both are there."""

import json
import shlex
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.namespaces import in_namespace, why_not

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.realtime
@pytest.mark.long
@pytest.mark.parametrize("build", ["plain"], indirect=True)
def test_motion_is_never_permitted_while_one_of_two_nodes_says_stop(build: Any) -> None:
    reason = why_not()
    if reason:
        pytest.skip(reason)
    pytest.importorskip("msgpack", reason="python-can's udp_multicast needs msgpack")
    driver = build(Path(__file__).with_name("driver.c"), sanitize=False)
    script = [sys.executable, "-m", "tests.hri_drivers.c.two_nodes", str(driver)]
    done = in_namespace(f"cd {shlex.quote(str(ROOT))} && exec {shlex.join(script)}", 300)
    assert done.returncode == 0, done.stderr
    outcome = json.loads(done.stdout.splitlines()[-1])
    receivers = outcome["together"]
    assert len(receivers) == 6
    assert receivers == dict.fromkeys(receivers, 0)
    assert not any(level.split()[0] in ("CLEAR", "WARN", "SLOW") for level in outcome["said"])
    assert outcome["foreign"][0] > 100, "the first node heard the second"
    assert all(outcome["alone"].values()), "with one node alone each would move"
