"""The wires between controllers: a permit that cannot be trusted is no permit."""

import math
import subprocess
import sys
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from hri_sim.controllers.controller import Watchdog
from hri_sim.controllers.wiring import PERMIT_STALE_S, Wiring

STALE_NS = int(PERMIT_STALE_S * 1e9)


def speed(wires, now_ns):
    return wires.lowest_permit(now_ns)[0]


def test_no_permit_before_one_is_given():
    wires = Wiring.in_memory(["drive", "monitor"])
    assert speed(wires, 0) == 0.0
    assert wires.truth() is None
    wires.set_permit("drive", 1.0, 0)
    assert speed(wires, 0) == 0.0  # the monitor has not spoken


def test_the_lower_permit_rules():
    wires = Wiring.in_memory(["drive", "monitor"])
    wires.set_permit("drive", 1.0, 10)
    wires.set_permit("monitor", 0.25, 10)
    assert speed(wires, 10) == 0.25
    wires.set_permit("monitor", 2.0, 20)
    assert speed(wires, 20) == 1.0


def test_the_lowest_permit_comes_with_its_cause(tmp_path: Path):
    channels = ["drive", "monitor"]
    path = tmp_path / "wires"
    for wires in (Wiring.in_memory(channels), Wiring.create(path, channels)):
        wires.set_permit("drive", 1.0, 10, cause="clear")
        wires.set_permit("monitor", 0.0, 10, cause="stop")
        assert wires.lowest_permit(10) == (0.0, "stop")
        for at_ns, cause in enumerate(get_args(Watchdog), start=20):
            wires.set_permit("monitor", 0.0, at_ns, cause=cause)
            assert wires.lowest_permit(at_ns) == (0.0, cause)
        assert wires.lowest_permit(100 + STALE_NS) == (0.0, "other channel")  # nobody is there
        wires.close()


def test_a_robot_without_channels_has_no_permit():
    assert speed(Wiring.in_memory([]), 0) == 0.0


@pytest.mark.parametrize("speed", [math.nan, -1.0, -math.inf])
def test_an_absurd_permit_is_none(speed):
    wires = Wiring.in_memory(["a"])
    wires.set_permit("a", speed, 0)
    assert wires.permit("a", 0)[0] == 0.0


def test_a_permit_goes_stale_and_one_from_the_far_future_is_refused():
    wires = Wiring.in_memory(["a"])
    now = 10 * STALE_NS
    wires.set_permit("a", 1.0, now)
    assert wires.permit("a", now + STALE_NS)[0] == 1.0
    assert wires.permit("a", now + STALE_NS + 1)[0] == 0.0
    assert wires.permit("a", now - 1)[0] == 1.0  # written after the reader had read its clock
    assert wires.permit("a", now - STALE_NS - 1)[0] == 0.0


def test_a_torn_write_falls_back_to_the_one_before():
    buffer = bytearray(100_000)
    wires = Wiring(buffer, ["a"])
    wires.set_permit("a", 1.0, 1000)
    before = bytes(buffer)
    wires.set_permit("a", 2.0, 2000)
    changed = [i for i, (x, y) in enumerate(zip(before, buffer, strict=True)) if x != y]
    buffer[changed[-1]] ^= 0xFF  # as if the writer had been stopped half-way
    assert wires.permit("a", 2000)[0] == 1.0
    buffer[:] = bytes(b ^ 0x55 for b in buffer)
    assert wires.permit("a", 2000)[0] == 0.0


@pytest.mark.parametrize("joints", [1, 6, 7])
def test_truth_comes_back_bit_for_bit(joints):
    rng = np.random.default_rng(joints)
    wires = Wiring.in_memory(["a"])
    for stamp in range(3):
        q, qd = rng.normal(size=joints), rng.normal(size=joints)
        wires.set_truth(q, qd, 1.5, stamp)
        truth = wires.truth()
        assert truth is not None
        np.testing.assert_array_equal(truth.q, q)
        np.testing.assert_array_equal(truth.qd, qd)
        assert (truth.path_s, truth.stamp_ns) == (1.5, stamp)


def test_truth_is_carried_on_while_the_drive_lives_and_rests_once_it_is_dead():
    wires = Wiring.in_memory(["a"])
    wires.set_truth(np.array([1.0]), np.array([2.0]), 0.0, 0)
    truth = wires.truth()
    assert truth is not None
    q, qd = truth.at(10_000_000)
    np.testing.assert_allclose(q, [1.02])
    np.testing.assert_allclose(qd, [2.0])
    q, qd = truth.at(1_000_000_000)
    np.testing.assert_allclose(q, [1.0])
    np.testing.assert_allclose(qd, [0.0])


_WRITER = """
import sys, numpy as np
from pathlib import Path
from hri_sim.controllers.wiring import Wiring
wires = Wiring.open(Path(sys.argv[1]), ["drive", "monitor"])
for i in range(1, 20001):
    wires.set_truth(np.full(6, float(i)), np.full(6, -float(i)), float(i), i)
wires.set_permit("monitor", 0.5, 7)
"""


@pytest.mark.long
def test_two_processes_share_it_and_a_reader_never_sees_a_mixture(tmp_path: Path):
    path = tmp_path / "wires"
    wires = Wiring.create(path, ["drive", "monitor"])
    writer = subprocess.Popen([sys.executable, "-c", _WRITER, str(path)])
    seen = set()
    last = 0
    while writer.poll() is None or last < 20000:
        truth = wires.truth()
        if truth is None:
            continue
        assert set(truth.q) == {truth.path_s}
        assert set(truth.qd) == {-truth.path_s}
        assert truth.stamp_ns == truth.path_s
        assert truth.stamp_ns >= last
        last = truth.stamp_ns
        seen.add(last)
        assert writer.poll() in (None, 0)
    assert len(seen) > 10
    assert wires.permit("monitor", 7)[0] == 0.5
    assert wires.permit("drive", 7)[0] == 0.0
    wires.close()


def test_wires_of_another_shape_are_refused(tmp_path: Path):
    Wiring.create(tmp_path / "wires", ["a"]).close()
    with pytest.raises(ValueError, match="a different number of channels"):
        Wiring.open(tmp_path / "wires", ["a", "b"])
    with pytest.raises(OSError):
        Wiring.open(tmp_path / "absent", ["a"])
