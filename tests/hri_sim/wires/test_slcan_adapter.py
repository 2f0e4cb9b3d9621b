import contextlib
import os
import select
import threading
import time
from typing import Any

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.can.transport import CanTransport
from hri_predict.base.errors import LinkError
from hri_predict.protocol.can import CanFrame
from hri_sim.wires.slcan_adapter import FD_LENGTHS, SlcanAdapter, from_line, open_pty, to_line


@pytest.fixture
def line():
    """An adapter and the file descriptor of whoever stands at its serial port."""
    master, path = open_pty()
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    adapter = SlcanAdapter(master)
    adapter.open()
    yield adapter, port
    os.close(port)
    adapter.close()


def ask(line, data):
    """What the adapter answers, and which frames it takes."""
    adapter, port = line
    os.write(port, data)
    frames = adapter.read(5.0)
    while more := adapter.read(0.02):
        frames += more
    answer = b""
    while select.select([port], [], [], 0.05 if answer else 5.0)[0]:
        answer += os.read(port, 4096)
    return answer, frames


frames = st.builds(
    lambda extended, fd, identifier, size, fill: CanFrame(
        identifier & (0x1FFFFFFF if extended else 0x7FF),
        (fill * 64)[: size if fd else min(size, 8)],
        fd=fd,
        extended=extended,
    ),
    st.booleans(),
    st.booleans(),
    st.integers(0, 0x1FFFFFFF),
    st.sampled_from(FD_LENGTHS),
    st.binary(min_size=1, max_size=8),
)


@given(frames)
def test_a_frame_survives_its_line(frame):
    assert from_line(to_line(frame)) == frame


@given(st.text(st.characters(min_codepoint=0, max_codepoint=255), max_size=40))
def test_a_line_that_is_no_frame_is_none(text):
    frame = from_line(text)
    assert frame is None or to_line(frame)[1:].lower() == text[1:].lower()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "t",
        "t1",
        "t1239",
        "t12310",
        "t123200",
        "t12321G",
        "t8000",
        "T200000000",
        "t 12100",
        "dF",
    ],
)
def test_wrong_frames(text):
    assert from_line(text) is None


def test_commands_are_answered_as_the_manual_says(line):
    adapter, _ = line
    assert ask(line, b"C\r")[0] == b"\r"
    assert ask(line, b"S6\r")[0] == b"\r"
    assert ask(line, b"Y5\r")[0] == b"\r"
    assert (adapter.bitrate, adapter.data_bitrate) == (500_000, 5_000_000)
    assert ask(line, b"V\r")[0][:1] == b"V"
    assert ask(line, b"N\r")[0][:1] == b"N"
    assert ask(line, b"t1230\r") == (b"\a", [])  # closed: nothing passes
    assert ask(line, b"O\r")[0] == b"\r"
    assert ask(line, b"S5\r")[0] == b"\a"  # open: the bit rate stays
    assert adapter.bitrate == 500_000
    assert ask(line, b"t1232AB01\r") == (b"z\r", [CanFrame(0x123, b"\xab\x01")])
    assert ask(line, b"T000001231FF\r") == (b"Z\r", [CanFrame(0x123, b"\xff", extended=True)])
    assert ask(line, b"r1230\r") == (b"z\r", [])
    assert adapter.remote_frames == 1
    assert ask(line, b"C\rL\r")[0] == b"\r\r"
    assert ask(line, b"t1230\r") == (b"\a", [])  # listens only
    assert adapter.malformed == 0


@pytest.mark.parametrize(
    "wrong", [b"X\r", b"S\r", b"S10\r", b"Sx\r", b"O1\r", b"\xff\xfe\r", b"t12\r"]
)
def test_nonsense_is_refused_and_counted(line, wrong):
    adapter, _ = line
    assert ask(line, wrong) == (b"\a", [])
    assert adapter.malformed == 1


@given(st.lists(st.binary(max_size=300), max_size=20))
def test_garbage_never_stops_it(chunks):
    master, path = open_pty()
    port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    adapter = SlcanAdapter(master)
    adapter.open()
    try:
        wanted, got, deadline = CanFrame(0x123, b"\xee"), [], time.monotonic() + 60
        for chunk in [*chunks, b"\rC\rO\rt1231EE\r"]:
            while chunk and time.monotonic() < deadline:  # the kernel hands on at its leisure
                with contextlib.suppress(BlockingIOError):
                    chunk = chunk[os.write(port, chunk) :]
                got += adapter.read(0.0)
        while got[-1:] != [wanted] and time.monotonic() < deadline:
            got += adapter.read(0.01)
        assert got[-1:] == [wanted]
        assert len(adapter._buffer) <= 200
    finally:
        os.close(port)
        adapter.close()


def test_frames_for_a_closed_channel_are_counted_not_sent(line):
    adapter, port = line
    adapter.write(CanFrame(0x1, b"\x01"))
    assert adapter.not_passed == 1
    ask(line, b"O\r")
    adapter.write(CanFrame(0x1, b"\x01"))
    assert os.read(port, 100) == b"t001101\r"


def test_a_driver_that_goes_without_goodbye_closes_the_channel(line):
    adapter, port = line
    ask(line, b"O\r")
    assert adapter.channel_open
    extra = os.dup(port)
    os.close(extra)
    assert adapter.read(0.0) == []
    assert adapter.channel_open
    os.dup2(os.open(os.devnull, os.O_RDWR), port)  # the last one on the port goes
    assert adapter.read(0.05) == []
    assert not adapter.channel_open


def test_after_closing_it_refuses():
    master, _ = open_pty()
    adapter = SlcanAdapter(master)
    adapter.close()
    adapter.close()
    with pytest.raises(LinkError, match="closed"):
        adapter.read(0.0)


@pytest.mark.parametrize("fd", [False, True])
def test_python_cans_driver_talks_to_it_both_ways(fd):
    """The independent peer: python-can's own slcan driver, on a real pseudo-terminal."""
    master, path = open_pty()
    adapter = SlcanAdapter(master)
    adapter.open()
    taken: list[CanFrame] = []
    stop = threading.Event()

    def serve():
        while not stop.is_set():
            taken.extend(adapter.read(0.05))

    thread = threading.Thread(target=serve)
    thread.start()
    driver = CanTransport(
        interface="slcan", channel=path, bitrate=250_000, fd=fd, options={"sleep_after_open": 0}
    )
    try:
        driver.open()
        deadline = time.monotonic() + 60
        while not (adapter.channel_open and adapter.bitrate):
            assert time.monotonic() < deadline
            stop.wait(0.02)
        sizes = FD_LENGTHS if fd else range(9)
        sent = [CanFrame(0x100 + n, bytes(range(n)), fd=fd, extended=bool(n % 2)) for n in sizes]
        for frame in sent:
            driver.write(frame)
            adapter.write(frame)
        heard: list[CanFrame] = []
        while not len(heard) == len(sent) == len(taken) and time.monotonic() < deadline:
            heard += driver.read(0.05)
        assert heard == sent
        assert taken == sent
        assert adapter.malformed == 0
        assert adapter.bitrate == 250_000
        assert adapter.data_bitrate == (2_000_000 if fd else None)
    finally:
        driver.close()
        stop.set()
        thread.join()
        assert not adapter.channel_open or adapter.read(0.2) == []
        adapter.close()


def test_python_can_reads_its_version_and_serial_number():
    master, path = open_pty()
    adapter = SlcanAdapter(master)
    adapter.open()
    stop = threading.Event()

    def serve():
        while not stop.is_set():
            adapter.read(0.05)

    thread = threading.Thread(target=serve)
    thread.start()
    bus: Any = can.Bus(interface="slcan", channel=path, sleep_after_open=0, ignore_config=True)
    try:
        assert bus.get_version(60.0) == (10, 13)
        assert bus.get_serial_number(60.0) == "HRI1"
    finally:
        bus.shutdown()
        stop.set()
        thread.join()
        adapter.close()
