"""What an interface of python-can needs is missed before a run, not in it."""

import sys

import pytest
from can.interfaces import BACKENDS

from hri_drivers.links.can.link import CanLink
from hri_drivers.links.can.packages import demand_packages
from hri_drivers.links.can.settings import CanLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError


def link(interface: str) -> CanLinkSettings:
    return CanLinkSettings(name="drive", interface=interface, channel="239.74.163.2")


def test_without_msgpack_one_line_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "msgpack", None)
    with pytest.raises(LinkError) as caught:
        CanLink(link("udp_multicast"), MonotonicClock())  # as check builds it, never opened
    assert str(caught.value) == (
        "link 'drive': CAN interface udp_multicast needs msgpack; install it with: "
        "pip install 'hri-predict[udp]'"
    )
    demand_packages("drive", "virtual")  # who does not need it does not miss it


def test_an_interface_without_its_driver_is_told_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, BACKENDS["gs_usb"][0], None)
    with pytest.raises(LinkError, match="'drive': CAN interface gs_usb: its driver is not avail"):
        CanLink(link("gs_usb"), MonotonicClock())


@pytest.mark.parametrize("interface", ["socketcan", "slcan", "virtual", "socketcand"])
def test_what_python_can_brings_itself_is_there(interface):
    demand_packages("drive", interface)


def test_a_driver_that_cannot_be_imported_is_told_in_one_line(monkeypatch):
    monkeypatch.setitem(BACKENDS, "pcan", ("no_such_driver_anywhere", "Bus"))
    with pytest.raises(LinkError, match="no_such_driver_anywhere"):
        demand_packages("drive", "pcan")
