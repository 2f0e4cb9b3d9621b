"""A CAN bus in trouble: what SocketCAN raises and sends, from a bus that stands in for the kernel.

The bus raises what python-can's socketcan raises (``CanOperationError`` with the kernel's number),
sends the error frames that the kernel sends (include/uapi/linux/can/error.h), and keeps the file
in which the kernel says whether the controller takes part (/sys/class/net/can0/carrier).
"""

import contextlib
import errno
import os
import queue
from pathlib import Path
from typing import Any, ClassVar

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.can import errors as can_errors
from hri_drivers.links.can.errors import BusHealth, why_not_on_bus
from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.can.transport import CanTransport
from hri_predict.base.clock import MonotonicClock, VirtualClock
from hri_predict.base.errors import LinkError
from hri_predict.protocol.can import CanSender
from hri_predict.protocol.messages import Acknowledge
from hri_sim.faults.link_faults import FaultyTransport
from tests.hri_drivers.links.pairs import advice, more
from tests.waiting import eventually

PASSIVE = can.Message(
    is_error_frame=True, arbitration_id=0x004, is_extended_id=False, data=b"\0\x20\0\0\0\0\x80\0"
)
ACTIVE = can.Message(
    is_error_frame=True, arbitration_id=0x004, is_extended_id=False, data=b"\0\x40\0\0\0\0\0\0"
)
BUS_OFF = can.Message(
    is_error_frame=True, arbitration_id=0x040, is_extended_id=False, data=bytes(8)
)


class Kernel:
    """A CAN device and its controller."""

    def __init__(self, sysfs: Path) -> None:
        self._device = sysfs / "can0"
        self._device.mkdir()
        self.heard: queue.SimpleQueue[Any] = queue.SimpleQueue()  # messages and errors, for recv
        self.sent: list[can.Message] = []
        self.send_error: int | None = None
        self.filters: Any = None
        self.opened = 0
        self.back_on_bus()

    def back_on_bus(self) -> None:
        (self._device / "carrier").write_text("1\n")
        self.send_error = None

    def bus_off(self) -> None:
        (self._device / "carrier").write_text("0\n")
        self.send_error = errno.ENOBUFS
        self.heard.put(BUS_OFF)


class KernelBus(can.BusABC):
    """Raises what ``can.interfaces.socketcan.SocketcanBus`` raises."""

    kernel: ClassVar[Kernel]

    def __init__(self, channel: str, can_filters: Any = None, **kwargs: Any) -> None:
        self.kernel.opened += 1
        super().__init__(channel, can_filters, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        number = self.kernel.send_error
        if number is not None:
            raise can.CanOperationError(
                f"Failed to transmit: {os.strerror(number)}", number
            ) from OSError(number, os.strerror(number))
        self.kernel.sent.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            heard = self.kernel.heard.get(timeout=timeout or 0.001)
        except queue.Empty:
            return None, True
        if isinstance(heard, int):
            raise can.CanOperationError(f"Error receiving: {os.strerror(heard)}", heard) from (
                OSError(heard, os.strerror(heard))
            )
        return heard, True

    def _apply_filters(self, filters: Any) -> None:
        self.kernel.filters = filters


@pytest.fixture
def kernel(monkeypatch, tmp_path):
    monkeypatch.setattr(can_errors, "SYSFS", tmp_path)
    KernelBus.kernel = kernel = Kernel(tmp_path)
    monkeypatch.setattr("can.interface._get_class_for_interface", lambda interface: KernelBus)
    return kernel


@contextlib.contextmanager
def started(**more: Any):
    settings = CanLinkSettings(name="plc", interface="socketcan", channel="can0", **more)
    link = CanLink(settings, MonotonicClock())
    link.start()
    try:
        yield link
    finally:
        link.stop()


def hear(kernel: Kernel, message: Any) -> None:
    for frame in CanSender().encode(message):
        kernel.heard.put(
            can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=False)
        )


@pytest.mark.realtime
def test_bus_off_is_told_and_the_link_comes_back_by_itself(kernel):
    with started() as link:
        link.post(advice(1))
        eventually(lambda: len(kernel.sent) == 3)
        kernel.bus_off()
        eventually(lambda: not link.connected)
        assert (link.counters.bus_off, link.counters.bus_errors) == (1, 1)
        assert "can0: bus-off" in str(link.last_error)
        assert "restart-ms" in str(link.last_error)
        opened = kernel.opened
        link.post(advice(2))

        kernel.back_on_bus()  # by restart-ms, or by hand
        eventually(lambda: link.connected and len(kernel.sent) == 6)
        assert kernel.opened == opened + 1  # while it was off, nothing was opened
        assert (link.counters.disconnects, link.counters.reconnects) == (1, 1)
        hear(kernel, Acknowledge(2, 9))
        received: list[Any] = []
        eventually(lambda: received or more(received, link.take()))
        assert received[0].message == Acknowledge(2, 9)


@pytest.mark.realtime
def test_a_full_transmit_queue_costs_no_newer_advice(kernel):
    with started() as link:
        kernel.send_error = errno.ENOBUFS
        for latch_id in range(1, 6):
            link.post(advice(latch_id))
        eventually(lambda: link.counters.write_errors > 3)
        assert "transmit queue full" in str(link.last_error)
        assert kernel.sent == []
        kernel.send_error = None
        eventually(lambda: len(kernel.sent) >= 3)
        assert kernel.sent[2].data[2] == 5  # LATCH_ID's low byte: the newest
        assert link.connected


@pytest.mark.realtime
def test_a_queue_that_stays_full_gets_the_interface_opened_afresh(kernel):
    with started() as link:
        kernel.send_error = errno.ENOBUFS
        link.post(advice(1))
        eventually(lambda: kernel.opened > 1)
        kernel.send_error = None
        eventually(lambda: len(kernel.sent) >= 3)
        assert link.counters.disconnects >= 1


@pytest.mark.realtime
@pytest.mark.parametrize("way", ["sending", "receiving"])
def test_a_device_that_is_set_down_is_named_and_taken_up_again(kernel, way, monkeypatch, tmp_path):
    with started() as link:
        (tmp_path / "can0" / "carrier").unlink()
        real = Path.read_text

        def read_text(path: Path, **more: Any) -> str:
            if path.name == "carrier" and not path.exists():  # as the kernel answers
                raise OSError(errno.EINVAL, "Invalid argument")
            return real(path, **more)

        monkeypatch.setattr(Path, "read_text", read_text)
        if way == "sending":
            kernel.send_error = errno.ENETDOWN
            link.post(advice(1))
        else:
            kernel.heard.put(errno.ENETDOWN)
        eventually(lambda: not link.connected)
        eventually(lambda: "the device is down; bring it up" in str(link.last_error))
        kernel.back_on_bus()
        link.post(advice(2))
        eventually(lambda: link.connected and len(kernel.sent) == 3)


@pytest.mark.realtime
def test_error_passive_is_counted_once_and_told(kernel):
    with started() as link:
        for frame in (PASSIVE, PASSIVE, ACTIVE, PASSIVE):
            kernel.heard.put(frame)
        eventually(lambda: link.counters.bus_errors == 4)
        assert link.counters.error_passive == 2
        assert "error-passive" in str(link.last_error)
        assert link.connected
        link.post(advice(1))
        eventually(lambda: len(kernel.sent) == 3)


def test_injected_faults_do_not_hide_what_the_bus_reports(kernel):
    settings = CanLinkSettings(name="c", interface="socketcan", channel="can0")
    clock = VirtualClock()
    faulty: Any = FaultyTransport(
        inner=CanLink.make_transport(settings), faults=[], clock=clock, seed=0
    )
    link = CanLink(settings, clock, faulty)
    link.service(0)
    kernel.heard.put(PASSIVE)
    link.service(1)
    assert link.counters.error_passive == 1
    assert "error-passive" in str(link.last_error)


def test_on_the_virtual_clock_bus_off_is_the_same(kernel):
    clock = VirtualClock()
    link = CanLink(CanLinkSettings(name="c", interface="socketcan", channel="can0"), clock)
    link.service(0)
    kernel.bus_off()
    link.service(1)
    assert not link.connected
    clock.advance_to(100_000_000)
    link.service(clock.now_ns())
    assert not link.connected
    kernel.back_on_bus()
    clock.advance_to(1_000_000_000)
    link.service(clock.now_ns())
    assert link.connected


def test_the_kernel_is_given_the_ids_of_this_link_alone(kernel):
    transport = CanLink.make_transport(
        CanLinkSettings(name="c", interface="socketcan", channel="can0", isotp={"peer_id": 0x123})
    )
    transport.open()
    passing = {
        identifier
        for identifier in range(0x800)
        if any((identifier ^ f["can_id"]) & f["can_mask"] == 0 for f in kernel.filters)
    }
    assert passing == {*range(0x680, 0x6C7), *range(0x6C8, 0x6E0), 0x123}
    assert not any(f["extended"] for f in kernel.filters)
    transport.close()


def test_filters_of_ones_own_go_first(kernel):
    own = [{"can_id": 0x10, "can_mask": 0x7F0}]
    settings = CanLinkSettings(
        name="c", interface="socketcan", channel="can0", options={"can_filters": own}
    )
    transport = CanLink.make_transport(settings)
    transport.open()
    assert kernel.filters == own
    transport.close()


def test_a_controller_that_is_off_the_bus_is_told_at_the_start(kernel):
    kernel.bus_off()
    transport = CanTransport(interface="socketcan", channel="can0")
    with pytest.raises(LinkError, match=r"bus-off.*ip link set can0 type can restart"):
        transport.open()


def test_every_number_of_the_kernels_header():
    health = BusHealth()
    tell = {
        (0x004, 0x01): "overflowed",
        (0x004, 0x04): "warning",
        (0x004, 0x08): "warning",
        (0x004, 0x10): "error-passive",
        (0x004, 0x20): "error-passive",
        (0x020, 0x00): "no node acknowledges",
        (0x040, 0x00): "bus-off",
    }
    for (classes, controller), words in tell.items():
        assert words in str(BusHealth().feed(classes, bytes((0, controller))))
        health.feed(classes, bytes((0, controller)))
    assert (health.off, health.passive, health.frames) == (1, 1, 7)
    assert health.feed(0x004, b"\0\x20") is not None
    assert health.feed(0x004, b"\0\x10") is None  # the same again
    assert health.feed(0x004, b"\0\x40") is None  # error-active
    assert health.feed(0x004, b"\0\x20") is not None
    assert health.feed(0x100, bytes(8)) is None  # restarted
    assert health.state == "active"


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8))
def test_whatever_an_error_frame_holds_is_survived(classes, data):
    health = BusHealth()
    trouble = health.feed(classes, data)
    assert health.frames == 1
    assert trouble is None or "\n" not in trouble
    assert (health.state == "off") == bool(classes & 0x040)


def test_a_device_that_nobody_knows_is_left_to_the_driver_to_refuse():
    assert why_not_on_bus("no_such_can") is None
    assert why_not_on_bus("../etc") is None


def test_listening_only_never_sends(kernel):
    transport = CanTransport(interface="socketcan", channel="can0", listen_only=True)
    transport.open()
    with pytest.raises(LinkError, match="listens only"):
        transport.write(CanSender().encode(Acknowledge(1, 1))[0])
    assert kernel.sent == []
    transport.close()
