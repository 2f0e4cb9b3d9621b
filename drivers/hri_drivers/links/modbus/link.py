"""A Modbus TCP server as a link: a PLC reads the advice, and writes states and acknowledges.

``drivers/MODBUS.md`` defines the registers, ``docs/guides/modbus.md`` describes the PLC's side.
Nothing on this link is protected end to end.
"""

from typing import ClassVar

from pydantic import Field

from hri_drivers.links.modbus.server import ModbusTransport
from hri_drivers.links.plant.codec import RegisterCodec
from hri_drivers.links.plant.image import Block, Image
from hri_drivers.links.plant.link import PlantLink, PlantLinkSettings
from hri_drivers.wires.transport import Transport
from hri_predict.base.quantities.safe_side import Safety, harmless

UNPROTECTED = (
    "Modbus carries neither a CRC nor a counter from this node, and does not identify the sender: "
    "not protected end to end; the PLC must stop when HEARTBEAT or ADVICE_COUNTER stops changing "
    "(drivers/MODBUS.md)"
)


class ModbusLinkSettings(PlantLinkSettings):
    """An entry of ``links:`` with ``kind: modbus``."""

    kind: str = "modbus"
    port: int = Field(5020, ge=0, le=65_535, description="TCP port; 502 needs elevated privileges")
    robot_state_rate_hz: float = Field(
        50.0, ge=0, le=1000, description="rate at which PLCs write RobotState"
    )
    plc_timeout_s: float = Field(
        1.0, ge=0.05, le=60, description="a PLC_HEARTBEAT unchanged for longer is reported"
    )

    safety: ClassVar[Safety] = harmless("plc_timeout_s")
    protocol: ClassVar[str] = "Modbus"

    @property
    def notes(self) -> list[str]:
        """See ``LinkSettings``."""
        return [UNPROTECTED]


class ModbusLink(PlantLink[ModbusLinkSettings]):
    """``contracts.link.Link`` whose other end polls; arguments as for ``ConfiguredLink``."""

    settings_model: ClassVar[type[ModbusLinkSettings]] = ModbusLinkSettings
    unprotected: ClassVar[str] = UNPROTECTED

    @staticmethod
    def make_transport(settings: ModbusLinkSettings) -> ModbusTransport:
        """The server, not yet open."""
        image = Image(settings.silence_timeout_s, settings.age_limit_s)
        return ModbusTransport((settings.host, settings.port), image)

    @staticmethod
    def _make_codec(settings: ModbusLinkSettings, wire: Transport[Block]) -> RegisterCodec:
        return RegisterCodec(settings.plc_timeout_s, lambda: getattr(wire, "refused", 0))

    @staticmethod
    def receiver(settings: ModbusLinkSettings) -> RegisterCodec:
        """Return a decoder of what a PLC writes, for listeners."""
        return RegisterCodec(settings.plc_timeout_s)
