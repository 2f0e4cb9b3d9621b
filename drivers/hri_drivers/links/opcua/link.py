"""An OPC UA server as a link: clients read the advice or subscribe to it, and call Acknowledge.

``drivers/OPCUA.md`` defines the variables, ``docs/guides/opcua.md`` describes the PLC's side.
"""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import ClassVar, Self

from pydantic import Field, model_validator

from hri_drivers.links.opcua.transport import OpcUaTransport
from hri_drivers.links.plant.link import PlantLink, PlantLinkSettings
from hri_predict.base.errors import LinkError
from hri_predict.base.quantities.safe_side import Safety

UNPROTECTED = (
    "OPC UA carries no CRC or counter from this node: not protected end to end; a client must stop "
    "when a status is not Good, and when HEARTBEAT or ADVICE_COUNTER stops changing "
    "(drivers/OPCUA.md)"
)
OPEN = "no security policy: anyone who can reach the port can read values and call the methods"


class OpcUaLinkSettings(PlantLinkSettings):
    """An entry of ``links:`` with ``kind: opcua``."""

    kind: str = "opcua"
    port: int = Field(4840, ge=0, le=65_535, description="TCP port")
    robot_state_rate_hz: float = Field(
        0.0, ge=0, le=0, description="0: OPC UA carries no RobotState"
    )
    certificate: Path | None = Field(
        None, description="the server's certificate; only Basic256Sha256, signed and encrypted"
    )
    private_key: Path | None = Field(None, description="the server's RSA key, as PEM")
    trusted: list[Path] = Field([], max_length=64, description="certificates of the clients")

    protocol: ClassVar[str] = "OPC UA without certificates"
    safety: ClassVar[Safety] = {}

    @property
    def knows_clients(self) -> bool:
        """Whether clients must authenticate themselves."""
        return self.certificate is not None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        given = [self.certificate is not None, self.private_key is not None, bool(self.trusted)]
        if any(given) and not all(given):
            raise ValueError("certificate, private_key and trusted go together; give all or none")
        return self

    def resolved(self, base_dir: Path) -> Self:
        """These settings with file paths resolved from ``base_dir``."""
        found = {
            key: value and base_dir / value
            for key, value in (("certificate", self.certificate), ("private_key", self.private_key))
        }
        trusted = [base_dir / path for path in self.trusted]
        return self.model_copy(update={**found, "trusted": trusted})

    @property
    def notes(self) -> list[str]:
        """See ``LinkSettings``."""
        return [UNPROTECTED] if self.knows_clients else [UNPROTECTED, OPEN]


class OpcUaLink(PlantLink[OpcUaLinkSettings]):
    """``contracts.link.Link`` whose other end reads; arguments as for ``ConfiguredLink``."""

    settings_model: ClassVar[type[OpcUaLinkSettings]] = OpcUaLinkSettings
    unprotected: ClassVar[str] = UNPROTECTED
    reads_hz: ClassVar[float] = 50.0
    word_bytes: ClassVar[int] = 40  # a notification has handle, value, status and both timestamps

    @staticmethod
    def _demand(settings: OpcUaLinkSettings) -> None:
        if find_spec("asyncua") is None:
            raise LinkError(
                f"link '{settings.name}' needs a package that is not installed: asyncua; "
                "pip install 'hri-predict[opcua]'"
            )

    @staticmethod
    def make_transport(settings: OpcUaLinkSettings) -> OpcUaTransport:
        """The server, not yet open."""
        return OpcUaTransport(
            {
                "name": settings.name,
                "host": settings.host,
                "port": settings.port,
                "silence_s": settings.silence_timeout_s,
                "max_age_s": settings.max_age_s,
                "certificate": str(settings.certificate or ""),
                "private_key": str(settings.private_key or ""),
                "trusted": [str(path) for path in settings.trusted],
            }
        )

    def _prepare(self, settings: OpcUaLinkSettings, robots: Sequence[int]) -> None:
        super()._prepare(settings, robots)
        device = getattr(self._transport, "device", self._transport)  # beneath injected faults
        if isinstance(device, OpcUaTransport):
            device.robots = tuple(robots)
            device.say = self._say
