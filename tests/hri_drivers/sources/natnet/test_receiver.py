"""What Motive is asked, and when: something else at once, the same once in a while."""

import socket
from types import SimpleNamespace

from hri_drivers.sources.natnet import source as natnet
from hri_drivers.sources.natnet.source import ASK_S, NEXT_S


def test_what_is_needed_next_is_asked_without_waiting(monkeypatch):
    now, wanted = [100.0], [0]
    monkeypatch.setattr(natnet, "time", SimpleNamespace(monotonic=lambda: now[0]))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as motive:
        motive.bind(("127.0.0.1", 0))
        motive.settimeout(20)
        client = natnet.NatNetReceiver(
            server="127.0.0.1",
            command_port=motive.getsockname()[1],
            host="127.0.0.1",
            group=None,
            data_port=0,
            wanted=lambda: wanted[0],
        )
        client.open()
        asked: list[int | None] = []
        for message, later_s in ((0, 0.0), (0, NEXT_S), (4, 0.0), (4, NEXT_S), (4, ASK_S)):
            wanted[0] = message
            now[0] += later_s + 0.001
            client.read(0.0)
            motive.setblocking(False)
            try:
                asked.append(int.from_bytes(motive.recv(100)[:2], "little"))
            except BlockingIOError:
                asked.append(None)
        client.close()
    assert asked == [0, None, 4, None, 4]
