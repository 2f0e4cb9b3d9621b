"""USB adapters are found by what they are, whatever their name is now."""

from dataclasses import dataclass
from typing import Any

import pytest

from hri_drivers.links.serial.link import SerialLinkSettings
from hri_drivers.wires.usb_ports import UsbDevice, find_port
from hri_predict.base.errors import ConfigError, LinkError
from hri_predict.base.settings import validated


@dataclass
class Port:
    device: str
    vid: int | None = None
    pid: int | None = None
    serial_number: str | None = None
    location: str | None = None


BUILT_IN = Port("/dev/ttyS0")
A5 = Port("/dev/ttyUSB0", 0x0403, 0x6001, "A5", "1-1")
A6 = Port("/dev/ttyUSB1", 0x0403, 0x6001, "A6", "1-2")
CHEAP_LEFT = Port("/dev/ttyUSB2", 0x1A86, 0x7523, None, "1-3")
CHEAP_RIGHT = Port("/dev/ttyUSB3", 0x1A86, 0x7523, None, "1-4")
ALL = [BUILT_IN, A5, A6, CHEAP_LEFT, CHEAP_RIGHT]


def usb(**keys: Any) -> UsbDevice:
    return UsbDevice.model_validate(keys)


def test_by_serial_number_by_location_and_alone_of_its_kind():
    assert find_port(usb(vid=0x0403, pid=0x6001, serial_number="A6"), ALL) == "/dev/ttyUSB1"
    assert find_port(usb(vid=0x1A86, pid=0x7523, location="1-4"), ALL) == "/dev/ttyUSB3"
    assert find_port(usb(vid=0x0403, pid=0x6001), [BUILT_IN, A5]) == "/dev/ttyUSB0"


def test_ids_may_be_written_as_lsusb_does():
    assert usb(vid="0403", pid="0x6001") == usb(vid=0x0403, pid=0x6001)


@pytest.mark.parametrize(
    ("ports", "there"),
    [
        ([], "no USB serial ports found here"),
        ([BUILT_IN], "no USB serial ports found here"),
        ([A6, BUILT_IN], "here: /dev/ttyUSB1 is 0403:6001 serial_number 'A6' location '1-2'"),
    ],
)
def test_one_that_is_not_there_is_told_with_what_is_there(ports, there):
    with pytest.raises(LinkError) as caught:
        find_port(usb(vid=0x0403, pid=0x6001, serial_number="A5"), ports)
    assert str(caught.value) == (
        f"USB device 0403:6001 serial_number 'A5': not found; plug it in or correct 'usb' ({there})"
    )


def test_two_of_a_kind_are_never_guessed_between():
    with pytest.raises(LinkError) as caught:
        find_port(usb(vid=0x1A86, pid=0x7523), ALL)
    assert str(caught.value) == (
        "USB device 1a86:7523: 2 devices match; add 'serial_number' or 'location' "
        "(here: /dev/ttyUSB2 is 1a86:7523 location '1-3', "
        "/dev/ttyUSB3 is 1a86:7523 location '1-4')"
    )


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"usb": {"vid": 0x0403, "pid": "zz"}}, "usb.pid: write it as 0x0403, or as in lsusb"),
        ({"usb": {"vid": 0x0403, "pid": 0x10000}}, "usb.pid: "),
        ({"usb": {"vid": 0x0403}}, "usb.pid: required key is missing"),
        ({"usb": {"vid": 1, "pid": 2, "serial": "x"}}, "did you mean 'serial_number'"),
        ({"port": "/dev/x", "usb": {"vid": 1, "pid": 2}}, "give either 'port' or 'usb'"),
        ({}, "give 'port' (a device path or URL), 'usb', or 'simulate'"),
        ({"port": "x", "xonxoff": True}, "xonxoff: frames contain the bytes 11h and 13h"),
        ({"port": "x", "parity": "evne"}, "parity: "),
        ({"port": "x", "stop_bits": 3}, "stop_bits: "),
        ({"port": "socket://here"}, "port: give host and port, such as socket://192.168.0.7:4001"),
        ({"port": "socket://here:http"}, "port: give host and port"),
        ({"port": "rfc2217://:99"}, "port: give host and port"),
        ({"port": "rfc2217://here:999999"}, "port: give host and port"),
    ],
)
def test_wrong_settings_get_one_line_with_the_remedy(keys, words):
    with pytest.raises(ConfigError) as caught:
        validated(SerialLinkSettings, {"name": "plc", **keys}, "cell.yaml: links.0")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
