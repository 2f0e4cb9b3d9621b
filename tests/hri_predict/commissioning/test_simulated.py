"""The stand-in for a cell: people who walk everywhere, and a mock controller at each link."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import JOINTS
from hri_predict.commissioning.playback import circles_of
from hri_predict.commissioning.simulated import (
    LANE_M,
    is_simulated,
    simulated,
    walkers,
    with_people,
    with_toucher,
)
from hri_predict.run import assemble
from tests.hri_predict.commissioning.cells import cell_data, load_cell

REAL = [
    {"name": "plc", "kind": "can", "interface": "socketcan", "channel": "can0", "fd": True},
    {"name": "drive", "kind": "serial", "port": "/dev/ttyUSB0", "baudrate": 921600},
]
UDP = {
    "kind": "udp", "rate_hz": 30, "joint_map": "coco17",
    "room_from_source": {"xyz": [1, 2, 3]}, "stale_s": 0.2,
}  # fmt: skip


@pytest.fixture
def real(tmp_path):
    return load_cell(tmp_path, cell_data(source=UDP, links=REAL))


def test_real_links_get_one_drive_and_monitors(real):
    assert not is_simulated(real)
    stand_in = simulated(real, circles_of(real))
    assert is_simulated(stand_in)
    links: Any = stand_in.links
    plc, drive = links
    assert (plc.simulate, drive.simulate) == (
        {"role": "drive", "robot": "arm", "trajectory": "pick_and_place"},
        {"role": "monitor", "robot": "arm"},
    )
    assert plc.interface == "slcan"
    assert not plc.fd
    assert drive.baudrate == 921600
    assert [link.simulate for link in real.links] == [None, None]


def test_people_are_seen_as_the_cells_tracker_sees_them(real):
    source: Any = with_people(real, []).source
    assert (source.kind, source.joint_map, source.stale_s) == ("procedural", "coco17", 0.2)
    assert source.room_from_source.xyz == [0, 0, 0]


def test_a_cells_own_mock_controllers_stay(tmp_path):
    config = load_cell(tmp_path)
    assert simulated(config, circles_of(config)).links == config.links


def test_a_robot_that_stands_is_refused(tmp_path):
    data = cell_data(links=REAL)
    data["robots"][0]["motion"] = {"kind": "standing", "positions": [0, -1.5, 1.5, 0, 0, 0]}
    config = load_cell(tmp_path, data)
    with pytest.raises(ConfigError, match="robot arm has motion 'standing'"):
        simulated(config, circles_of(config))


def test_somebody_keeps_the_hand_at_the_point(tmp_path):
    point = np.array([0.6, -0.5, 0.9])
    data = cell_data()
    data["source"] |= {"joint_map": "xsens23", "room_from_source": {"xyz": [1, 0, 0]}}
    source: Any = assemble.build_source(with_toucher(load_cell(tmp_path, data), point))
    source.open(0)
    hand = source.truth(10_000_000_000)[1][0][JOINTS.index("r_hand")]
    assert np.linalg.norm(hand - point) < 0.02  # who stands sways


circles = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(1, 5))


@given(st.lists(circles, min_size=1, max_size=3), st.floats(0, 1), st.floats(0, 6.28))
def test_the_lanes_leave_no_floor_out(rows, part, angle):
    found = np.array(rows)
    people = walkers(found)
    lanes = []
    for person in people:
        points = [person["start"], *(act["to"] for act in person["script"])]
        lanes += [(np.array(points[i]), np.array(points[i + 1])) for i in range(0, len(points), 2)]
    x, y, radius = found[0]
    here = np.array([x, y]) + part * radius * np.array([np.cos(angle), np.sin(angle)])

    def away(a, b):
        along = np.clip((here - a) @ (b - a) / max((b - a) @ (b - a), 1e-9), 0, 1)
        return np.linalg.norm(here - a - along * (b - a))

    # a circle's left and right ends are rounder than a lane is wide
    assert min(away(a, b) for a, b in lanes) < LANE_M * 1.5


def test_the_walk_goes_as_far_as_the_largest_margin_of_a_body_region(tmp_path):
    plain = circles_of(load_cell(tmp_path))
    data = cell_data()
    data["risk"]["region_margins_m"] = {"head": 0.2, "thorax": 0.1}
    assert circles_of(load_cell(tmp_path, data)) - plain == pytest.approx(
        np.tile([0.0, 0.0, 0.2], (len(plain), 1))
    )
