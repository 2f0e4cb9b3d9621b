"""The link and a controller in another process, over TCP: faults end in 0, and it comes back."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pydantic import ValidationError

from hri_drivers.links.rtde.link import RtdeLink, RtdeLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.protocol.messages import Advice, Level, RobotMode, RobotState
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.wire import StateShape
from hri_predict.robots.settings import RobotSettings
from tests.hri_drivers.links.rtde.rtde_robot import Robot
from tests.silent_server import SilentServer
from tests.waiting import eventually

pytestmark = pytest.mark.realtime
Make = Callable[..., RtdeLink]


def settings(**changes: Any) -> RtdeLinkSettings:
    data = {"name": "arm", "host": "127.0.0.1", "full_speed_m_s": 1.0, "max_age_s": 0.4}
    data |= {"hold_s": 0.1} | changes
    return RtdeLinkSettings(rise_per_s=2.0, **data)


@pytest.fixture
def link() -> Iterator[Make]:
    made: list[RtdeLink] = []

    def make(robot: Robot | SilentServer, start: bool = True, **changes: Any) -> RtdeLink:
        made.append(RtdeLink(settings(port=robot.port, **changes), MonotonicClock()))
        if start:
            made[-1].start()
        return made[-1]

    yield make
    for each in made:
        each.stop()


def advice(level: Level = Level.CLEAR, limit: float = 1.0) -> Advice:
    return Advice(robot=0, level=level, reason=Reason.NONE, speed_limit_m_s=limit, age_s=0.05)


def driven(link: RtdeLink, condition: Callable[[], Any], what: Advice | None = None) -> Any:
    """Post as the node does until something happens."""

    def step() -> Any:
        link.post(what or advice())
        return condition()

    return eventually(step)


def states(link: RtdeLink, count: int) -> list[RobotState]:
    found: list[RobotState] = []

    def enough() -> bool:
        found.extend(r.message for r in link.take() if isinstance(r.message, RobotState))
        return len(found) >= count

    eventually(enough)
    return found


def shown(robot: Robot, **values: Any) -> bool:
    """Whether the newest line of the controller has these values."""
    return bool(robot.lines) and all(robot.lines[-1].get(k) == v for k, v in values.items())


def test_states_come_in_and_the_slider_follows_the_advice(robot, link):
    there = robot()
    arm = link(there)
    driven(arm, lambda: shown(there, slider=1.0, level=1))
    driven(arm, lambda: shown(there, slider=0.25, level=3), advice(Level.SLOW, 0.25))
    driven(arm, lambda: shown(there, slider=0.0, level=4), advice(Level.STOP, 0.0))
    assert {line["safety_mode"] for line in there.lines} == {1}  # no jump from 0
    assert there.lines[0]["slider"] == 0.0
    driven(arm, lambda: shown(there, slider=1.0))
    arm.take()
    found = states(arm, 20)
    driven(arm, lambda: any(abs(v) > 0.1 for s in states(arm, 1) for v in s.velocities))
    counters = [state.counter for state in found]
    assert counters == list(range(counters[0], counters[0] + len(counters)))
    assert {state.mode for state in found} == {RobotMode.AUTOMATIC}
    assert arm.counters.malformed == 0


def test_the_arm_of_the_controller_stands_while_the_advice_stops_it(robot, link):
    there = robot()
    arm = link(there)
    driven(arm, lambda: any(abs(v) > 0.1 for s in states(arm, 1) for v in s.velocities))
    stop = advice(Level.STOP, 0.0)
    driven(arm, lambda: all(v == 0.0 for s in states(arm, 1) for v in s.velocities), stop)


def test_without_advice_the_link_writes_zero_and_unknown(robot, link):
    there = robot()
    arm = link(there)
    driven(arm, lambda: shown(there, slider=1.0, level=1))
    eventually(lambda: shown(there, slider=0.0, level=0))


def test_the_last_word_is_zero_and_unknown(robot, link):
    there = robot()
    arm = link(there)
    driven(arm, lambda: shown(there, slider=1.0, level=1))
    arm.post(advice())
    arm.stop()
    eventually(lambda: shown(there, slider=0.0, level=0))


def test_a_controller_that_starts_again_gets_zero_first(robot, link):
    there = robot()
    arm = link(there)
    driven(arm, lambda: shown(there, slider=1.0))
    there.kill()
    driven(arm, lambda: not arm.connected)
    assert arm.last_error is not None
    again = robot(port=there.port)
    driven(arm, lambda: shown(again, slider=1.0))
    assert again.lines[0]["slider"] == 0.0
    assert arm.counters.disconnects >= 1
    assert arm.counters.reconnects == 1
    assert {line["safety_mode"] for line in again.lines} == {1}


def test_a_controller_that_hangs_is_lost_and_found(robot, link):
    there = robot()
    arm = link(there)
    driven(arm, lambda: shown(there, slider=1.0))
    there.pause(signal.SIGSTOP)
    driven(arm, lambda: not arm.connected)
    assert "no data for 0.5 s" in (arm.last_error or "")
    there.pause(signal.SIGCONT)
    driven(arm, lambda: arm.connected and states(arm, 1))


def test_a_controller_that_sends_nothing_more_is_said(robot, link):
    arm = link(robot("--silent-after-s", "0.2"))
    driven(arm, lambda: "no data for 0.5 s" in (arm.last_error or ""))
    driven(arm, lambda: arm.counters.reconnects >= 1)


def test_other_bytes_are_counted_and_end_the_connection(robot, link):
    arm = link(robot("--garbage-after-s", "0.1"))
    driven(arm, lambda: "bytes that are not RTDE" in (arm.last_error or ""))
    driven(arm, lambda: arm.counters.reconnects >= 1 and arm.counters.malformed >= 1)


def test_packets_in_pieces_are_whole(robot, link):
    arm = link(robot("--piece", "7"))
    assert len(states(arm, 20)) >= 20
    assert arm.counters.malformed == 0


def test_a_time_stamp_that_stands_still_repeats_the_counter(robot, link):
    assert len({state.counter for state in states(link(robot("--frozen")), 10)}) == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--refuse-version",), "refuses RTDE protocol version 2; update its software"),
        (("--lacks", "actual_qd"), "does not know the output 'actual_qd'"),
        (("--lacks", "input_int_register_24"), "does not know the input 'input_int_register_24'"),
    ],
)
def test_a_controller_that_refuses_is_one_line_at_the_start(robot, link, options, said):
    there = robot(*options)
    with pytest.raises(LinkError, match=said) as error:
        link(there).start()
    assert str(error.value).startswith(f"link 'arm': RTDE at 127.0.0.1:{there.port}: ")
    assert "\n" not in str(error.value)


def test_a_register_of_another_client_is_said_and_taken_when_it_is_free(robot, link):
    there = robot()
    first = link(there)
    with pytest.raises(LinkError, match="'speed_slider_mask' is in use: another RTDE client"):
        link(there)
    second = link(there, wait_for_device=True)
    eventually(lambda: "is in use" in (second.last_error or ""))
    first.stop()
    driven(second, lambda: shown(there, slider=1.0))


def test_a_port_without_a_controller_is_one_line(link):
    silent = SilentServer()
    with pytest.raises(LinkError, match="no answer to request 'V' within 2 s; check that 'port'"):
        link(silent)


def test_an_address_without_a_server_is_one_line(robot, link):
    gone = robot()
    gone.kill()
    with pytest.raises(LinkError, match=r"cannot connect: .*; switch the controller on"):
        link(gone)


def test_the_watchdog_advances_once_with_each_advice(robot, link):
    there = robot("--each")
    arm = link(there)
    for _ in range(10):  # one after the other: a newer one takes the place of the one before
        arm.post(advice())
        eventually(lambda: not len(arm._slots))
    time.sleep(0.05)  # the registers are written again every 8 ms, without a new count
    eventually(lambda: shown(there, watchdog=10))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"level_register": 24}, "must differ"),
        ({"watchdog_register": 48}, "less than or equal to 47"),
        ({"simulate": {}}, "python -m hri_sim.rtde"),
        ({"host": ""}, "at least 1 character"),
        ({"robot_state_rate_hz": 1000}, "less than or equal to 500"),
    ],
)
def test_settings_that_cannot_be(wrong, said):
    with pytest.raises(ValidationError, match=said):
        settings(**wrong)


POSE = {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
ROBOT = RobotSettings.model_validate(
    {"name": "a", "model": "ur5e", "room_from_robot": POSE, "max_speed_m_s": 1.5}
)


def test_full_speed_is_the_robots_and_never_below_it():
    given = settings(full_speed_m_s=None)
    assert RtdeLink.of_robots(given, [ROBOT]).full_speed_m_s == 1.5
    assert RtdeLink.of_robots(settings(full_speed_m_s=2.0), [ROBOT]).full_speed_m_s == 2.0
    with pytest.raises(
        LinkError, match=r"full_speed_m_s 1 is below the robot's max_speed_m_s 1\.5"
    ):
        RtdeLink.of_robots(settings(), [ROBOT])
    with pytest.raises(LinkError, match="one arm, and this link advises 2 robots"):
        RtdeLink.of_robots(given, [ROBOT, ROBOT])
    with pytest.raises(LinkError, match="full_speed_m_s is missing"):
        RtdeLink(given, MonotonicClock())


def test_a_robot_of_seven_joints_is_refused():
    with pytest.raises(LinkError, match="six joints on a fixed base"):
        RtdeLink.load(settings(), 25.0, (0,), (StateShape(7),))


def test_a_port_that_is_taken_ends_the_made_up_controller_in_one_line(robot):
    there = robot()
    command = [sys.executable, "-m", "hri_sim.rtde", "--port", str(there.port)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith(f"hri_sim.rtde: cannot listen on 127.0.0.1:{there.port}: ")
    assert ended.stderr.count("\n") == 1
