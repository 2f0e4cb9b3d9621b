"""A link that reads a robot's state from a Modbus TCP server; see ``docs/guides/modbus.md``."""

import socket
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator
from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException

from hri_drivers.links.configured import WITHOUT_DEVICE
from hri_drivers.links.polled.link import PolledLink
from hri_drivers.links.polled.settings import (
    HEARTBEAT,
    MODE,
    NO_MODE,
    READS_ONLY,
    PolledLinkSettings,
    StateAt,
)
from hri_drivers.links.polled.transport import PolledTransport
from hri_drivers.wires.quiet import quiet
from hri_predict.base.errors import LinkError
from hri_predict.base.quantities.safe_side import Safety, harmless

Type = Literal["int16", "uint16", "int32", "uint32", "float32", "float64"]
Order = Literal["big", "little"]
MOST_WORDS = 125
"""Maximum number of registers in one request (Modbus application protocol 1.1b3, 6.3)."""
_FORMATS: dict[str, str] = {
    "int16": ">h",
    "uint16": ">H",
    "int32": ">i",
    "uint32": ">I",
    "float32": ">f",
    "float64": ">d",
}


def words_of(kind: Type) -> int:
    """Return the number of registers of a value of this type."""
    return struct.calcsize(_FORMATS[kind]) // 2


def number(words: Sequence[int], kind: Type, byte_order: Order, word_order: Order) -> float:
    """Return the number in these registers; big: the high byte, or the high word, comes first."""
    data = [word.to_bytes(2, byte_order) for word in words]
    if word_order == "little":
        data.reverse()
    found: float = struct.unpack(_FORMATS[kind], b"".join(data))[0]
    return found


@dataclass(frozen=True, slots=True)
class Slot:
    """A value's registers."""

    name: str
    at: int
    kind: Type

    @property
    def end(self) -> int:
        """The first register after it."""
        return self.at + words_of(self.kind)


def check_slots(slots: Sequence[Slot]) -> None:
    """Refuse registers that overlap, or that one request cannot read.

    Two requests could read values from two different moments.

    Raises:
        ValueError: one line with the remedy.
    """
    ordered = sorted(slots, key=lambda slot: slot.at)
    for a, b in pairwise(ordered):
        if b.at < a.end:
            raise ValueError(
                f"{b.name} at {b.at} lies in the registers {a.at} to {a.end - 1} of {a.name} "
                f"({a.kind}); correct one, or the type"
            )
    first, end = ordered[0].at, max(slot.end for slot in slots)
    if end - first > MOST_WORDS:
        raise ValueError(
            f"registers {first} to {end - 1} do not fit into one request of {MOST_WORDS}; let the "
            "controller write the state into neighbouring registers"
        )
    if end > 65_536:
        raise ValueError(f"{ordered[-1].name} goes past register 65535; correct it")


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
                f"cannot connect: {why}; switch the server on, or correct 'host' and 'port'; "
                f"{WITHOUT_DEVICE}"
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


UNPROTECTED = (
    "Modbus carries neither a CRC nor a counter for this node, and does not identify the sender: "
    "anyone who can write the server's registers can forge the robot's position "
    "(docs/guides/modbus.md)"
)
RegisterAt = Annotated[int, Field(ge=0, le=65_535)]


class RegisterState(StateAt[RegisterAt]):
    """``registers:`` of a ``modbus_client`` link; addresses count from 0, as on the wire."""

    type: Type = Field("float32", description="type of positions and velocities")
    heartbeat_type: Type = Field("uint16", description="type of the heartbeat")
    mode_type: Type = Field("uint16", description="type of the mode")
    byte_order: Order = Field("big", description="big: the high byte of a register is first")
    word_order: Order = Field(
        "big", description="big: the register with the high word has the lower address"
    )

    @property
    def slots(self) -> list[Slot]:
        """Registers of all values that are read."""
        kinds = {HEARTBEAT: self.heartbeat_type, MODE: self.mode_type}
        return [Slot(name, at, kinds.get(name, self.type)) for name, at in self.places]

    @model_validator(mode="after")
    def _can_be_read(self) -> Self:
        check_slots(self.slots)
        return self


class ModbusClientSettings(PolledLinkSettings):
    """An entry of ``links:`` with ``kind: modbus_client``."""

    kind: str = "modbus_client"
    port: int = Field(502, ge=1, le=65_535, description="TCP port of the device")
    unit: int = Field(1, ge=0, le=255, description="unit id of the device")
    table: Literal["holding", "input"] = Field(
        "holding", description="table of the registers: holding or input"
    )
    registers: RegisterState = Field(description="registers of the robot's state")

    safety: ClassVar[Safety] = harmless("port", "unit")

    @property
    def notes(self) -> list[str]:
        """See ``LinkSettings``."""
        known = self.registers.automatic or self.registers.mode is not None
        return [READS_ONLY, UNPROTECTED, *([] if known else [NO_MODE])]


class ModbusClientLink(PolledLink[ModbusClientSettings]):
    """``contracts.link.Link`` that reads registers; arguments as for ``ConfiguredLink``."""

    settings_model: ClassVar[type[ModbusClientSettings]] = ModbusClientSettings
    unprotected: ClassVar[str] = UNPROTECTED

    @staticmethod
    def make_transport(settings: ModbusClientSettings) -> ModbusClientTransport:
        """The connection, not yet open."""
        return ModbusClientTransport(
            (settings.host, settings.port),
            settings.registers.slots,
            table=settings.table,
            unit=settings.unit,
            byte_order=settings.registers.byte_order,
            word_order=settings.registers.word_order,
            reply_s=settings.reply_timeout_s,
            rate_hz=settings.robot_state_rate_hz,
        )

    @staticmethod
    def _state(settings: ModbusClientSettings) -> StateAt[Any]:
        return settings.registers
