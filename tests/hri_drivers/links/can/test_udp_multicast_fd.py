"""CAN FD over python-can's udp_multicast between two processes, in a network namespace."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TALK = Path(__file__).with_name("dbc_talk.py")
NETWORK = "ip link set lo up && ip route add 239.0.0.0/8 dev lo"


def in_namespace(command: str, seconds: float) -> subprocess.CompletedProcess[str]:
    """Run a shell command in a network of its own; nothing outside it is touched."""
    return subprocess.run(
        ["unshare", "--map-root-user", "--net", "sh", "-c", f"{NETWORK} && {command}"],
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )


def why_not() -> str | None:
    """Why this machine cannot do it, if it cannot."""
    for tool in ("unshare", "ip"):
        if shutil.which(tool) is None:
            return f"needs the program '{tool}' for a network namespace"
    tried = in_namespace("true", 20)
    if tried.returncode:
        return f"no network namespace here: {tried.stderr.strip().splitlines()[-1:]}"
    return None


@pytest.mark.realtime
@pytest.mark.long
def test_cantools_in_another_process_decodes_fd_frames_over_udp_multicast():
    reason = why_not()
    if reason:
        pytest.skip(reason)
    pytest.importorskip("msgpack", reason="python-can's udp_multicast needs msgpack")
    done = in_namespace(f"exec {sys.executable} {TALK} node udp_multicast fd", 120)
    assert done.returncode == 0, done.stderr
    outcome = json.loads(done.stdout)
    assert outcome["wrong"] == []
    assert outcome["compared"] > 1000
    assert outcome["counters"]["messages_sent"] == outcome["sent"]
    assert len(outcome["states"]) > 30
    assert outcome["counters"]["crc_errors"] == outcome["counters"]["counter_errors"] == 0
    assert outcome["counters"]["malformed"] == 0
