"""A ROS 2 node of ours, in a process of its own: Fast DDS reads its profiles once in each."""

import subprocess
from pathlib import Path

import pytest

from tests.processes import python

pytest.importorskip("rclpy", reason="needs the extra ros2, or a sourced ROS 2 installation")
pytestmark = [pytest.mark.long, pytest.mark.realtime]

OPEN = """
import os
from hri_drivers.wires.ros2 import Ros2Settings, SpinningNode
from hri_predict.base.errors import LinkError
def node(**settings):
    return SpinningNode(Ros2Settings.model_validate({"domain_id": 77} | settings))
before = dict(os.environ)
one = node()
made = one.open()
one.spin()
assert dict(os.environ) == before
"""


def run(script: str, **environment: str) -> subprocess.CompletedProcess[str]:
    import os

    return python("-c", OPEN + script, timeout=60, env=os.environ | environment)


LISTENING = """
inodes = set()
for fd in os.listdir("/proc/self/fd"):
    try:
        link = os.readlink(f"/proc/self/fd/{fd}")
    except OSError:
        continue
    if link.startswith("socket:["):
        inodes.add(link[8:-1])
rows = [line.split() for line in open("/proc/self/net/udp").readlines()[1:]]
ports = {int(row[1].split(":")[1], 16): row[1].split(":")[0] for row in rows if row[9] in inodes}
print(*(f"{port}={address}" for port, address in sorted(ports.items())))
one.close()
"""


@pytest.mark.skipif(not Path("/proc/self/net/udp").exists(), reason="reads Linux's socket table")
def test_the_sockets_of_a_domain_are_bound_to_loopback():
    """A domain's ports begin at 7400 + 250 times the domain (RTPS 2.3, 9.6.1.1)."""
    result = run(LISTENING)
    assert result.returncode == 0, result.stderr
    first = 7400 + 250 * 77
    found = dict(pair.split("=") for pair in result.stdout.split())
    received = {p: a for p, a in found.items() if first <= int(p) < first + 250}
    assert received
    assert set(received.values()) == {"0100007F"}  # 127.0.0.1, little-endian


def test_a_process_that_forgets_to_close_ends_cleanly():
    result = run("print('over')")
    assert (result.returncode, result.stdout, result.stderr) == (0, "over\n", "")


def test_a_node_closes_twice_and_opens_again():
    result = run("one.close(); one.close(); one.open(); one.spin(); one.close(); print('over')")
    assert (result.returncode, result.stdout) == (0, "over\n")


def test_a_callback_that_fails_is_logged_and_the_node_goes_on():
    result = run("""
import threading, time
times, done = [], threading.Event()
def tick():
    times.append(1)
    if len(times) == 1:
        raise ValueError("first")
    done.set()
made.create_timer(0.01, tick)
one._executor.wake()
print(done.wait(10))
""")
    assert (result.returncode, result.stdout) == (0, "True\n")
    assert "ValueError: first" in result.stderr


def test_two_nodes_of_a_process_have_the_same_discovery():
    result = run("""
try:
    node(discovery="subnet").open()
except LinkError as error:
    print(error)
""")
    assert result.stdout.strip() == (
        "discovery: subnet, but another ROS 2 node of this process has localhost; give the source "
        "and the links the same"
    )


def test_a_domain_that_is_none_is_named():
    result = run(
        """
try:
    node(domain_id=None).open()
except LinkError as error:
    print(error)
""",
        ROS_DOMAIN_ID="many",
    )
    assert result.stdout.startswith("ROS_DOMAIN_ID: 'many' is not a number from 0 to 232;")


def test_a_node_closes_again_and_again_under_a_flood():
    """Nothing is destroyed while the other thread waits for it: that aborted the process."""
    result = run("""
import threading
from std_msgs.msg import Int64
publisher = made.create_publisher(Int64, "/flood", 10)
stop = threading.Event()
def flood():
    while not stop.is_set():
        publisher.publish(Int64())
sender = threading.Thread(target=flood)
sender.start()
found = 0
for _ in range(10):
    other = node()
    heard = threading.Event()
    other.open().create_subscription(Int64, "/flood", lambda message: heard.set(), 10)
    other.spin()
    found += heard.wait(5)
    other.close()
stop.set()
sender.join()
one.close()
print(found > 0)
""")
    assert (result.returncode, result.stdout) == (0, "True\n"), result.stderr
