"""Why a bus does not open: each reason in one line, with what to install or correct."""

import errno

import can
import pytest

from hri_drivers.links.can.opening import open_limit_s, remedy
from hri_drivers.links.can.packages import demand_packages
from hri_predict.base.errors import LinkError


@pytest.mark.parametrize(
    ("interface", "error", "said"),
    [
        ("pcan", OSError("pcanbasic library not found."), "PEAK's library PCAN-Basic"),
        ("kvaser", NameError("name 'canGetNumberOfChannels' is not defined"), "library CANlib"),
        ("gs_usb", ModuleNotFoundError("No module named 'usb'"), "python-can[gs-usb]"),
        ("vector", can.CanInterfaceNotImplementedError("only on Windows"), "for Windows only"),
        ("ixxat", ImportError("cannot import name 'HRESULT'"), "HMS's VCI driver"),
        ("neovi", ImportError("Please install python-ics"), "python-can[neovi]"),
    ],
)
def test_a_missing_library_is_named_with_how_to_install_it(interface, error, said):
    line = remedy(error, interface)
    assert line.startswith("its driver is not available (")
    assert said in line
    assert "channel" not in line


def test_what_is_wrong_with_the_channel_stays_so():
    line = remedy(can.CanInitializationError("The value of a handle is invalid"), "pcan")
    assert "correct 'channel'" in line
    refused = OSError(errno.ECONNREFUSED, "Connection refused")
    assert "correct 'host' and 'port'" in remedy(refused, "socketcand")


@pytest.mark.parametrize(("interface", "said"), [("pcan", "PCAN-Basic"), ("kvaser", "CANlib")])
def test_a_missing_library_is_found_before_a_start(monkeypatch, interface, said, capfd):
    def absent(name: str) -> None:
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr("hri_drivers.links.can.packages.find_library", lambda name: None)
    monkeypatch.setattr("ctypes.cdll.LoadLibrary", absent)
    with pytest.raises(LinkError, match=f"link 'drive': .*{said}"):
        demand_packages("drive", interface)
    assert capfd.readouterr() == ("", "")  # python-can's own lines stay away


def test_an_adapter_that_boots_longer_has_longer():
    assert open_limit_s({"sleep_after_open": 20}) == 20 + open_limit_s({})
