"""A link that reads a robot's state from a Modbus TCP server; see ``docs/guides/modbus.md``."""

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from hri_drivers.links.modbus_client.registers import Order, Slot, Type, check_slots
from hri_drivers.links.modbus_client.transport import ModbusClientTransport
from hri_drivers.links.polled.link import PolledLink
from hri_drivers.links.polled.settings import (
    HEARTBEAT,
    MODE,
    NO_MODE,
    READS_ONLY,
    PolledLinkSettings,
    StateAt,
)
from hri_predict.base.quantities.safe_side import Safety, harmless

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
