"""Why a bus does not open: each reason in one line, with what to install or correct."""

import errno
import socket
import threading
from collections.abc import Iterator
from typing import Any

import can
import pytest

from hri_drivers.links.can.opening import open_limit_s, remedy
from hri_drivers.links.can.packages import demand_packages
from hri_drivers.links.can.transport import CanTransport
from hri_predict.base.errors import LinkError
from tests.hri_drivers.links.tcp_options import demand_options


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


SAYS = {
    "socketcand": {b"": b"< hi >", b"< open can0 >": b"< ok >", b"< rawmode >": b"< ok >"},
    "slcan": {},
}
"""What a server answers, so that python-can opens the interface; "" is the greeting."""


@pytest.fixture(params=SAYS)
def networked(request: Any) -> Iterator[CanTransport]:
    says = SAYS[request.param]
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while True:
                try:
                    peer, _ = server.accept()
                    peer.sendall(says.get(b"", b""))
                    while asked := peer.recv(4096):
                        peer.sendall(says.get(asked, b""))
                except OSError:
                    if server.fileno() < 0:
                        return

        threading.Thread(target=serve, daemon=True).start()
        port = server.getsockname()[1]
        options: dict[str, Any] = {"host": "127.0.0.1", "port": port}
        channel = "can0"
        if request.param == "slcan":
            options, channel = {"sleep_after_open": 0}, f"socket://127.0.0.1:{port}"
        made = CanTransport(interface=request.param, channel=channel, options=options)
        made.open()
        yield made
        made.close()
        server.shutdown(socket.SHUT_RDWR)  # wakes the thread


def test_can_over_tcp_delivers_nothing_late(networked: CanTransport) -> None:
    bus: Any = networked._bus
    port = getattr(bus, "serialPortOrig", None)
    demand_options(bus._SocketCanDaemonBus__socket if port is None else port._socket)
