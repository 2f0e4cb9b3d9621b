"""A server that does not start says why, and a late one ends."""

import asyncio
import errno
import socket
import threading
from typing import Any

import pytest

pytest.importorskip("pymodbus", reason="pymodbus is not installed: the link cannot be used")
from pymodbus.server import ModbusTcpServer

from hri_drivers.links.modbus import server as module
from hri_drivers.links.modbus.server import ModbusTransport
from hri_drivers.links.plant.image import Image
from hri_predict.base.errors import LinkError
from tests.waiting import eventually


def transport() -> ModbusTransport:
    return ModbusTransport(("127.0.0.1", 0), Image(0.06, 0.4))


def threads() -> list[str]:
    return [t.name for t in threading.enumerate() if t.name == "modbus-server"]


def test_the_reason_is_in_the_error(monkeypatch):
    async def fail(*_: Any, **__: Any) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(asyncio.base_events.BaseEventLoop, "create_server", fail)
    with pytest.raises(LinkError, match=r"did not start \(Too many open files\); remove the cause"):
        transport().open()


def test_a_server_that_starts_too_late_is_refused_and_ends(monkeypatch):
    go_on = threading.Event()
    listens: list[socket.socket] = []
    listen = ModbusTcpServer.listen

    async def late(self: ModbusTcpServer) -> bool:
        while not go_on.is_set():
            await asyncio.sleep(0.01)
        done = await listen(self)
        listens.extend(getattr(self.transport, "sockets", ()))
        return done

    monkeypatch.setattr(module, "START_S", 0.05)
    monkeypatch.setattr(ModbusTcpServer, "listen", late)
    with pytest.raises(LinkError, match=r"did not start within 0.05 s; check the load"):
        transport().open()
    assert threads()
    go_on.set()
    eventually(lambda: not threads())
    assert [each.fileno() for each in listens] == [-1]


def test_a_server_that_has_ended_says_why(monkeypatch):
    async def fail(*_: Any) -> None:
        raise RuntimeError("no more memory")

    made = transport()
    made.open()
    run: Any = made._run
    monkeypatch.setattr(ModbusTcpServer, "shutdown", fail)
    run.loop.call_soon_threadsafe(run.ended.set)
    eventually(lambda: not run.thread.is_alive())
    with pytest.raises(LinkError, match=r"has ended \(no more memory\)"):
        made.read(0.0)
    made.close()
