"""A sender for the zenoh source of the fault table, and its router. Needs the extra ``fleet``."""

import contextlib
import weakref
from pathlib import Path
from typing import Any

from hri_drivers.wires.zenoh import ZenohTransport
from hri_drivers.wires.zenoh_session import ZenohSettings, open_session
from hri_predict.base.errors import LinkError
from hri_predict.protocol.keyed import SCENE, Keyed, prefix
from hri_sim.senders.stream_ends import SceneStreamEnd
from hri_sim.wires.ports import free_tcp_port

_SITE, _CELL = "site", "faults"


class ZenohEnd(SceneStreamEnd):
    """The node's own scene stream, put under the scene's key; the router keeps running."""

    def __init__(self, _: Path) -> None:
        endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
        router = open_session(ZenohSettings(mode="router", listen=[endpoint]))
        weakref.finalize(self, router.close)
        self.source: dict[str, Any] = {
            "kind": "zenoh", "site": _SITE, "cell": _CELL, "connect": [endpoint],
        }  # fmt: skip
        settings = ZenohSettings(connect=[endpoint])
        self._transport = ZenohTransport(settings, prefix(_SITE, _CELL))

    def start(self) -> None:
        """Start a new session of zenoh and of the stream."""
        super().start()
        self._transport.open()

    def write(self, unit: bytes) -> None:
        """Put one unit, if the router is connected."""
        with contextlib.suppress(LinkError):
            self._transport.write(Keyed(SCENE, unit))

    def stop(self) -> None:
        """Close the zenoh session."""
        self._transport.close()
