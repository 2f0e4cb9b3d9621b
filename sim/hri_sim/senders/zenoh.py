"""A sender for the zenoh source in the fault table, and its router. Needs the extra ``fleet``."""

import contextlib
import weakref
from pathlib import Path

from hri_drivers.wires.zenoh import ZenohTransport
from hri_drivers.wires.zenoh_session import ZenohSettings, open_session
from hri_predict.base.errors import LinkError
from hri_predict.protocol.keyed import SCENE, Keyed, prefix
from hri_sim.senders.stream_ends import LiveEnd, SceneStream, Wire
from hri_sim.wires.ports import free_tcp_port

_SITE, _CELL = "site", "faults"


class Zenoh(Wire):
    """Units under the scene's key, through a router that keeps running.

    Attributes:
        endpoint: endpoint of the router.
    """

    def __init__(self) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
        router = open_session(ZenohSettings(mode="router", listen=[self.endpoint]))
        weakref.finalize(self, router.close)
        settings = ZenohSettings(connect=[self.endpoint])
        self._transport = ZenohTransport(settings, prefix(_SITE, _CELL))

    def open(self) -> None:
        """Start a new session."""
        self._transport.open()

    def write(self, unit: bytes) -> None:
        """Put one unit if the router is connected."""
        with contextlib.suppress(LinkError):
            self._transport.write(Keyed(SCENE, unit))

    def close(self) -> None:
        """Close the session."""
        self._transport.close()


def zenoh_end(_: Path) -> LiveEnd:
    """The node's own scene stream."""
    wire = Zenoh()
    source = {"kind": "zenoh", "site": _SITE, "cell": _CELL, "connect": [wire.endpoint]}
    return LiveEnd(SceneStream(), wire, source, checked=True)
