"""The connection to a Modbus TCP server, through pymodbus."""

import socket
from collections.abc import Sequence
from typing import Literal

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException

from hri_drivers.links.modbus_client.registers import Order, Slot, number
from hri_drivers.links.polled.transport import PolledTransport
from hri_drivers.wires.quiet import quiet
from hri_predict.base.errors import LinkError

quiet("pymodbus")  # it logs each error that it raises

CONNECT_S = 2.0
_REFUSALS = {
    1: "it does not support this request; set 'table' to the other value",
    2: "it has no such registers; correct the addresses in 'registers', 'table' or 'unit'",
    3: "it cannot send this many registers in one reply",
    4: "the device behind it has failed; see its log",
    10: "its gateway has no path to the device; correct 'unit'",
    11: "the device behind its gateway does not answer; switch it on, or correct 'unit'",
}
"""Exception codes (Modbus application protocol 1.1b3, 7)."""


class ModbusClientTransport(PolledTransport):
    """``Transport[Sample]`` of registers.

    Args:
        address: host and port of the server.
        slots: what is read.
        table, unit, byte_order, word_order, reply_s: see the settings.
        rate_hz: rate of the readings.
    """

    open_limit_s = 2 * CONNECT_S + 4.0

    def __init__(
        self,
        address: tuple[str, int],
        slots: Sequence[Slot],
        *,
        table: Literal["holding", "input"],
        unit: int,
        byte_order: Order,
        word_order: Order,
        reply_s: float,
        rate_hz: float,
    ) -> None:
        super().__init__(f"Modbus server at {address[0]}:{address[1]}", rate_hz)
        self._address, self._slots, self._unit = address, slots, unit
        self._table, self._orders, self._reply_s = table, (byte_order, word_order), reply_s
        self._first = min(slot.at for slot in slots)
        self._count = max(slot.end for slot in slots) - self._first
        self._client: ModbusTcpClient | None = None

    def _connect(self) -> None:
        try:
            connected = socket.create_connection(self._address, timeout=CONNECT_S)
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except (OSError, UnicodeError) as error:  # the latter: no host can have this name
            why = getattr(error, "strerror", "not a host's name") or "no answer"
            raise LinkError(
                f"cannot connect: {why}; switch the server on, or correct 'host' and 'port'"
            ) from error
        host, port = self._address
        self._client = ModbusTcpClient(host, port=port, timeout=self._reply_s, retries=0)
        self._client.socket = connected
        self._read()

    def _read(self) -> tuple[tuple[float | None, ...], str]:
        client = self._client
        if client is None or client.socket is None:  # it would connect again, and hide it
            raise LinkError("connection lost")
        holding = self._table == "holding"
        read = client.read_holding_registers if holding else client.read_input_registers
        try:
            reply = read(self._first, count=self._count, device_id=self._unit)
        except ModbusException as error:
            raise LinkError(self._lost(error)) from error
        except Exception as error:  # of any kind, on bytes that are not Modbus
            raise LinkError(f"connection lost ({type(error).__name__})") from error
        if reply.isError():
            code = getattr(reply, "exception_code", 0)
            why = _REFUSALS.get(code, "see the server's log")
            last = self._first + self._count - 1
            raise LinkError(
                f"it refuses to read {self._table} registers {self._first} to {last} (exception "
                f"{code}): {why}"
            )
        words = list(getattr(reply, "registers", ()))
        if len(words) != self._count:
            raise LinkError(f"it sent {len(words)} registers instead of {self._count}")
        return tuple(self._number(slot, words) for slot in self._slots), ""

    def _number(self, slot: Slot, words: Sequence[int]) -> float:
        at, end = slot.at - self._first, slot.end - self._first
        return number(words[at:end], slot.kind, *self._orders)

    def _lost(self, error: ModbusException) -> str:
        if "No response" in str(error):
            return (
                f"no answer within {self._reply_s:g} s; check that it is on, and correct 'unit' "
                f"and 'reply_timeout_s'"
            )
        return "the server closed the connection, or its answer is not Modbus TCP"

    def _disconnect(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()
