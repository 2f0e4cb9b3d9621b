"""A link that reads a robot's state from an OPC UA server; see ``docs/guides/opcua.md``."""

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, model_validator

from hri_drivers.links.opcua_client.transport import OpcUaClientTransport
from hri_drivers.links.polled.link import PolledLink
from hri_drivers.links.polled.settings import NO_MODE, READS_ONLY, PolledLinkSettings, StateAt
from hri_predict.base.errors import LinkError
from hri_predict.base.quantities.safe_side import Safety, harmless

UNPROTECTED = (
    "OPC UA carries no CRC or counter for this node: not protected end to end; anyone who can "
    "write the server's variables can forge the robot's position (docs/guides/opcua.md)"
)
OPEN = "no security policy: the server is not authenticated; give the three certificate keys"
NodeAt = Annotated[
    str,
    Field(
        max_length=256,
        pattern=r"^(ns=\d{1,5};)?(i=\d{1,10}|s=[^\x00-\x1f]+|g=[0-9A-Fa-f-]{36}|b=[A-Za-z0-9+/=]+)$",
    ),
]
"""A NodeId as text (OPC UA part 6, 5.3.1.10), such as ``ns=2;s=Robot.Joint1.Position``."""


class NodeState(StateAt[NodeAt]):
    """``nodes:`` of an ``opcua_client`` link; each address is a NodeId as text."""


class OpcUaClientSettings(PolledLinkSettings):
    """An entry of ``links:`` with ``kind: opcua_client``."""

    kind: str = "opcua_client"
    port: int = Field(4840, ge=1, le=65_535, description="its TCP port")
    path: str = Field(
        "",
        pattern=r"^(/[A-Za-z0-9._~/-]{0,200})?$",
        description="path of its address, such as /server",
    )
    nodes: NodeState = Field(description="nodes of the robot's state")
    certificate: Path | None = Field(
        None, description="this client's certificate; Basic256Sha256, signed and encrypted"
    )
    private_key: Path | None = Field(None, description="this client's RSA key, as PEM")
    server_certificate: Path | None = Field(None, description="certificate of the server")

    safety: ClassVar[Safety] = harmless("port")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        given = [self.certificate, self.private_key, self.server_certificate]
        if any(given) and not all(given):
            raise ValueError(
                "certificate, private_key and server_certificate go together; give all or none"
            )
        return self

    def resolved(self, base_dir: Path) -> Self:
        """These settings with file paths resolved from ``base_dir``."""
        keys = ("certificate", "private_key", "server_certificate")
        found = {key: path and base_dir / path for key in keys for path in [getattr(self, key)]}
        return self.model_copy(update=found)

    @property
    def notes(self) -> list[str]:
        """See ``LinkSettings``."""
        known = self.nodes.automatic or self.nodes.mode is not None
        secured = self.certificate is not None
        return [
            READS_ONLY,
            UNPROTECTED,
            *([] if secured else [OPEN]),
            *([] if known else [NO_MODE]),
        ]


class OpcUaClientLink(PolledLink[OpcUaClientSettings]):
    """``contracts.link.Link`` that reads variables; arguments as for ``ConfiguredLink``."""

    settings_model: ClassVar[type[OpcUaClientSettings]] = OpcUaClientSettings
    unprotected: ClassVar[str] = UNPROTECTED

    @staticmethod
    def _demand(settings: OpcUaClientSettings) -> None:
        if find_spec("asyncua") is None:
            raise LinkError(
                f"link '{settings.name}' needs a package that is not installed: asyncua; "
                "pip install 'hri-predict[opcua]'"
            )

    @staticmethod
    def make_transport(settings: OpcUaClientSettings) -> OpcUaClientTransport:
        """The connection, not yet open."""
        files = (settings.certificate, settings.private_key, settings.server_certificate)
        host = f"[{settings.host}]" if ":" in settings.host else settings.host
        return OpcUaClientTransport(
            f"opc.tcp://{host}:{settings.port}{settings.path}",
            settings.nodes.places,
            files=[path for path in files if path is not None],
            reply_s=settings.reply_timeout_s,
            rate_hz=settings.robot_state_rate_hz,
        )

    @staticmethod
    def _state(settings: OpcUaClientSettings) -> StateAt[Any]:
        return settings.nodes
