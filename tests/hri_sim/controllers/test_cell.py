"""The simulated cell on the virtual clock, and what it refuses."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hri_drivers.links.can.link import CanCodec, CanLinkSettings
from hri_drivers.links.framed import SerialCodec
from hri_drivers.links.serial.link import SerialLinkSettings
from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import ConfigError, RobotError
from hri_predict.base.settings import Pose
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Advice, Level, RobotMode, RobotState, Schema
from hri_predict.protocol.reasons import Reason
from hri_predict.robots.model import RobotSettings, load_robot
from hri_sim.controllers.cell import MockCell
from hri_sim.controllers.station import deceleration_of
from tests.arms import arm_settings

MS = 1_000_000
START = 5_000 * MS
ARM = RobotSettings(name="arm", model="ur5e", room_from_robot=Pose(), max_speed_m_s=1.0)
DRIVE = {"role": "drive", "robot": "arm", "trajectory": "pick_and_place"}
MONITOR = {"role": "monitor", "robot": "arm"}
GO = Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=1.0, echo=0, age_s=0.03)
STOP = replace(GO, level=Level.STOP, speed_limit_m_s=0.0)


def serial(simulate, name="drive", **more):
    return SerialLinkSettings(name=name, simulate=simulate, **more)


def can(simulate, name="monitor", **more):
    return CanLinkSettings(name=name, interface="slcan", simulate=simulate, **more)


class Played:
    """A cell with a drive on serial and a monitor on CAN, and a played node that hears both."""

    def __init__(self, **drive):
        links = [serial(DRIVE | drive), can(MONITOR)]
        self.clock = VirtualClock(START)
        self.cell = MockCell(links=links, robots=[ARM], base_dir=None, clock=self.clock)
        self.ends = self.cell.transports()
        self.codecs: dict[str, Any] = {"drive": SerialCodec(115200), "monitor": CanCodec(links[1])}
        self.echo: dict[str, int | None] = {"drive": None, "monitor": None}
        self.states: dict[str, list[RobotState]] = {"drive": [], "monitor": []}
        self.truth = []
        for end in self.ends.values():
            end.open()

    def run(self, ms, advice=None):
        """``advice``: link name -> what is advised there every 40 ms (default: GO on both)."""
        until = self.clock.now_ns() + ms * MS
        advised = {"drive": GO, "monitor": GO, **(advice or {})}
        tick = self.clock.now_ns()
        while self.clock.now_ns() < until:
            due = self.cell.next_ns()
            assert due is not None
            now = min(due, tick)
            self.clock.advance_to(now)
            if due <= now:
                self.cell.step(now)
            if tick <= now:
                self.tick(now, advised)
                tick += 40 * MS
        return self

    def tick(self, now, advised):
        for name, end in self.ends.items():
            codec = self.codecs[name]
            for unit in end.read(0.0):
                for message in codec.decode(unit):
                    assert isinstance(message, RobotState)
                    self.echo[name] = message.counter
                    self.states[name].append(message)
            messages = [Schema(SCHEMA_VERSION, SCHEMA_HASH)] if (now // MS) % 1000 < 40 else []
            if advised[name] is not None:
                messages.append(replace(advised[name], echo=self.echo[name]))
            for message in messages:
                for unit in codec.encode(message):
                    end.write(unit)
        truth = self.cell.robot_truth(now)
        if truth:
            self.truth.append((now, *truth["arm"]))

    def speed(self):
        model = load_robot(ARM, None)
        return float(model.tip_speed(*self.truth[-1][1:]))


def test_the_arm_moves_when_both_controllers_allow_it_and_both_report_it():
    played = Played().run(4000)
    q = np.array([t[1] for t in played.truth])
    assert np.ptp(q, axis=0).max() > 0.3
    for name in ("drive", "monitor"):
        states = played.states[name]
        assert len(states) == pytest.approx(200, abs=3)
        assert states[-1].mode is RobotMode.AUTOMATIC
        np.testing.assert_allclose(states[-1].positions, q[-1], atol=0.05)
    drive, monitor = played.cell.stop()
    assert (drive.name, drive.role, monitor.role) == ("drive", "drive", "monitor")
    assert drive.crc_errors == monitor.crc_errors == 0
    assert drive.stops == 0


def test_the_arm_starts_where_in_its_cycle_it_is_told_to():
    played = Played(start_s=3.4).run(80, {"drive": STOP})
    assert played.cell.path_s() == {"arm": 3.4}


def test_what_the_drive_hears_and_says_is_late_at_its_end_of_the_wire():
    late = [{"kind": "delay", "delay_s": 0.1}]
    played = Played(faults=late).run(1000)
    prompt = Played().run(1000)
    ways = played.cell.stop()[0].round_trip_p50_s - prompt.cell.stop()[0].round_trip_p50_s
    # 0.1 s each way, and up to a cycle of the drive and of the node until it is noticed
    assert 0.2 <= ways <= 0.25
    assert len(prompt.states["drive"]) - len(played.states["drive"]) == pytest.approx(5, abs=2)


def test_the_same_seed_loses_the_same_at_the_drives_end():
    def heard(seed):
        loss = [{"kind": "drop", "probability": 0.2}]
        return [s.counter for s in Played(faults=loss, fault_seed=seed).run(2000).states["drive"]]

    assert heard(1) == heard(1) != heard(2)
    assert len(heard(1)) == pytest.approx(80, abs=12)  # of 100


def test_an_unknown_fault_of_the_drive_is_refused():
    with pytest.raises(ConfigError, match=r"links\.drive\.simulate\.faults.*unknown fault 'drip'"):
        Played(faults=[{"kind": "drip"}])


@pytest.mark.parametrize("who", ["drive", "monitor"])
@pytest.mark.parametrize("how", [STOP, None])
def test_either_channel_alone_stops_the_arm(who, how):
    played = Played().run(3000)
    played.run(1500, {who: how})
    assert played.speed() == 0.0
    drive, monitor = played.cell.stop()
    assert drive.stops == 1
    assert monitor.stops == (1 if who == "monitor" else 0)
    if who == "monitor":
        assert drive.stop_causes == {"silent" if how is None else "stop": 1}


def test_a_speed_limit_of_either_channel_holds():
    slow = replace(GO, level=Level.SLOW, speed_limit_m_s=0.1)
    played = Played().run(2500)
    played.run(1000, {"monitor": slow})
    at = len(played.truth)
    played.run(6000, {"monitor": slow})
    model = load_robot(ARM, None)
    speeds = [float(model.tip_speed(q, qd)) for _, q, qd in played.truth[at:]]
    assert max(speeds) <= 0.1 + 0.005
    assert max(speeds) > 0.05


@pytest.mark.long
def test_the_arm_stops_within_the_stopping_table_from_anywhere():
    model = load_robot(ARM, None)
    played = Played()
    rng = np.random.default_rng(1)
    for _ in range(15):
        played.run(int(rng.integers(1200, 3000)))
        now, q, qd = played.truth[-1]
        speed = float(model.tip_speed(q, qd))
        at = len(played.truth)
        played.run(1200, {"drive": STOP})
        time_s, _ = model.stopping(max(speed, 0.1))
        # advice is heard in the controller's next cycle, and acts after the reaction
        limit_ns = now + int((0.008 + 0.040 + 0.05 + time_s + 0.3 * speed + 0.02) * 1e9)
        late = [t for t, _, v in played.truth[at:] if t > limit_ns and np.any(v != 0)]
        assert not late
    played.cell.stop()


def test_deceleration_keeps_time_and_distance_of_the_table():
    model = load_robot(ARM, None)
    a = deceleration_of(model, 1.5)
    for speed in np.linspace(0.05, 1.5, 30):
        time_s, distance_m = model.stopping(speed)
        assert speed / a <= time_s + 1e-9
        assert speed**2 / (2 * a) <= distance_m + 1e-9


def test_two_runs_are_the_same_to_the_bit():
    def run():
        played = Played().run(3000).run(500, {"drive": STOP}).run(1000)
        return [(t, q.tobytes(), qd.tobytes()) for t, q, qd in played.truth], played.cell.stop()

    assert run() == run()


def test_a_robot_whose_motion_is_a_trajectory_lends_it_to_its_drive():
    arm = arm_settings(motion={"kind": "trajectory", "file": "pick_and_place"})
    MockCell(links=[serial({"role": "drive"})], robots=[arm], base_dir=None, clock=VirtualClock())


@pytest.mark.parametrize(
    ("links", "message"),
    [
        ([serial({**DRIVE, "roll": 1})], r"links\.drive\.simulate: roll.*did you mean 'role'"),
        ([serial({**DRIVE, "role": "driver"})], r"role"),
        ([serial({**DRIVE, "robot": "amr"})], "did you mean 'arm'"),
        (
            [serial({"role": "drive", "robot": "arm"})],
            "simulate.trajectory: missing; name the path",
        ),
        ([can(MONITOR)], "has 0 simulated drives"),
        ([serial(DRIVE), can(DRIVE)], "has 2 simulated drives"),
        ([serial(DRIVE, robots=["other"])], "carries no advice"),
    ],
)
def test_a_wrong_simulate_block_is_refused_in_one_line(links, message):
    with pytest.raises(ConfigError, match=message) as caught:
        MockCell(links=links, robots=[ARM], base_dir=None, clock=VirtualClock())
    assert "\n" not in str(caught.value)


def test_a_robot_must_be_named_where_there_are_several():
    second = ARM.model_copy(update={"name": "second"})
    with pytest.raises(ConfigError, match="use one of: arm, second"):
        MockCell(
            links=[serial({"role": "drive"})],
            robots=[ARM, second],
            base_dir=None,
            clock=VirtualClock(),
        )


def test_an_unknown_trajectory_is_refused():
    with pytest.raises(RobotError, match="pick_and_place"):
        MockCell(
            links=[serial({**DRIVE, "trajectory": "pick"})],
            robots=[ARM],
            base_dir=None,
            clock=VirtualClock(),
        )
