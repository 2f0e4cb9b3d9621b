import re

import pytest

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_predict.base.errors import ConfigError, LinkError
from hri_predict.base.settings import validated
from hri_predict.contracts.link import check_load
from hri_predict.protocol.wire import StateShape
from hri_predict.risk.delay_budget import DelayBudget


def can(**more):
    return CanLinkSettings(name="cell", interface="virtual", channel="x", **more)


def serial(**more):
    return SerialLinkSettings(name="cell", port="/dev/ttyX0", **more)


def test_a_classic_bus_counts_135_bits_a_frame():
    # By hand: Status 1 frame and Advice 3 at 25 Hz, Schema 1 at 1 Hz, RobotState 5 at 50 Hz.
    load = CanLink.load(can(robot_state_rate_hz=50), 25, [0])
    frames = 25 * (1 + 3) + 1 + 50 * 5
    assert load.load == pytest.approx(frames * 135 / 500_000)
    assert load.spare == pytest.approx(1 - load.load - 0.3)


def test_each_robot_adds_its_advice_and_its_state():
    one, two = (CanLink.load(can(), 25, robots) for robots in ([0], [0, 1]))
    assert two.details["Advice"] == pytest.approx(2 * one.details["Advice"])
    assert two.details["RobotState"] == pytest.approx(2 * one.details["RobotState"])
    assert two.details["Status"] == one.details["Status"]


@pytest.mark.parametrize(
    ("shape", "frames", "octets"),
    [
        (StateShape(6), 5, 30),
        (StateShape(7), 6, 36),
        (StateShape(9), 7, 42),
        (StateShape(6, moving_base=True), 7, 54),
        (StateShape(9, moving_base=True), 9, 54),
    ],
)
def test_a_state_counts_with_the_parts_that_its_robot_needs(shape, frames, octets):
    shapes = [StateShape(), shape]
    classic = CanLink.load(can(robot_state_rate_hz=50), 25, [0, 1], shapes)
    assert classic.details["RobotState"] == pytest.approx(50 * (5 + frames) * 135 / 500_000)
    line = SerialLink.load(serial(robot_state_rate_hz=50), 25, [0, 1], shapes)
    bits = 10 * (30 + 14) + 10 * (octets + 14)
    assert line.details["RobotState"] == pytest.approx(50 * bits / 115_200)


def test_a_moving_base_without_frames_on_classic_can_is_refused_with_the_remedy():
    moving = StateShape(6, moving_base=True)
    assert CanLink.load(can(), 25, [3], [moving]).load > 0
    with pytest.raises(
        LinkError, match=r"not for robots\[4\]; list that robot earlier, or use CAN FD"
    ):
        CanLink.load(can(), 25, [0, 4], [StateShape(), moving])
    assert CanLink.load(can(fd=True), 25, [4], [moving]).load > 0


def test_status_counts_at_ten_hertz_even_in_a_slow_node():
    slow, ten = (CanLink.load(can(), rate, [0]).details for rate in (5, 10))
    assert slow["Status"] == ten["Status"]
    assert slow["Advice"] == pytest.approx(ten["Advice"] / 2)


@pytest.mark.parametrize(
    ("link", "settings", "rate_hz"),
    [
        (SerialLink, serial(baudrate=57_600), 100),
        (SerialLink, serial(baudrate=38_400), 25),
        (CanLink, can(bitrate=125_000), 100),
        (CanLink, can(bitrate=50_000), 25),
    ],
)
def test_what_does_not_fit_is_refused_and_what_is_proposed_fits(link, settings, rate_hz):
    with pytest.raises(LinkError) as caught:
        check_load(link.load(settings, rate_hz, [0]))
    text = str(caught.value)
    assert "\n" not in text
    assert "link 'cell'" in text
    proposals = 0
    if rate := re.search(r"rate_hz from \S+ to (\d+)", text):
        proposals += 1
        check_load(link.load(settings, int(rate[1]), [0]))
        with pytest.raises(LinkError):
            check_load(link.load(settings, int(rate[1]) + 2, [0]))
    if faster := re.search(r"bit rate from \d+ to (\d+)", text):
        proposals += 1
        key = "baudrate" if link is SerialLink else "bitrate"
        check_load(link.load(settings.model_copy(update={key: int(faster[1])}), rate_hz, [0]))
    if reserved := re.search(r"reserved_load to ([\d.]+)", text):
        proposals += 1
        update = {"reserved_load": float(reserved[1])}
        check_load(link.load(settings.model_copy(update=update), rate_hz, [0]))
    assert proposals


def test_a_bus_beyond_all_remedies_still_gets_one():
    settings = can(bitrate=1_000_000, robot_state_rate_hz=1000)
    with pytest.raises(LinkError, match="fewer robots"):
        check_load(CanLink.load(settings, 10, list(range(8))))


def test_fd_takes_less_time_than_classic_at_the_same_nominal_rate():
    classic, fd = (CanLink.load(can(fd=fd), 25, [0]).load for fd in (False, True))
    assert fd < classic


@pytest.mark.parametrize(
    ("model", "data", "words"),
    [
        (CanLinkSettings, {"interface": "socketcn", "channel": "can0"}, "did you mean 'socketcan'"),
        (CanLinkSettings, {"interface": "socketcn", "channel": "can0"}, "slcan"),
        (CanLinkSettings, {"interface": "virtual"}, "give 'channel'"),
        (CanLinkSettings, {"interface": "virtual", "channel": "x", "base_id": 2000}, "base_id"),
        (
            CanLinkSettings,
            {"interface": "virtual", "channel": "x", "fd": True, "data_bitrate": 100_000},
            "data_bitrate",
        ),
        (SerialLinkSettings, {}, "give 'port'"),
        (SerialLinkSettings, {"port": "/dev/ttyS0", "baudrat": 9600}, "did you mean 'baudrate'"),
        (SerialLinkSettings, {"port": "/dev/ttyS0", "baudrate": 0}, "baudrate"),
    ],
)
def test_mistakes_in_the_configuration_get_one_line(model, data, words):
    with pytest.raises(ConfigError) as caught:
        validated(model, {"name": "cell", **data}, "node.yaml: links.0")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_not_urgent_counts_as_delay():
    slow, fast = (SerialLinkSettings(name="s", port="x", baudrate=b) for b in (115_200, 921_600))
    # two milliseconds ahead, and a frame of a few hundred bits
    assert 0.004 < slow.blocking_s < 0.015
    assert fast.blocking_s - 0.002 == pytest.approx((slow.blocking_s - 0.002) / 8)
    can = CanLinkSettings(name="c", interface="virtual", channel="0", bitrate=500_000)
    assert can.blocking_s == pytest.approx(135 / 500_000)
    fd = can.model_copy(update={"fd": True})
    assert 0.002 < fd.blocking_s < 0.004
    budget = DelayBudget.from_settings(25.0, [slow], 0.12)
    assert budget.terms()["link_delay"] == pytest.approx(slow.delay_s + slow.blocking_s)
