"""A viser server that publishes nothing beyond its own address."""

import contextlib
import io
import logging
import socket

import viser

from hri_predict.viewing.scene3d.panel import ROOM_FOR_BAR, legend

TITLE = "hri-predict"
MAX_AHEAD_S = 3.0
"""End of the slider of zones ahead until the horizon is known."""


def bounded(value: float, low: float, high: float) -> float:
    """Return a slider's value; any client of the port can send any number, even NaN."""
    return min(max(value, low), high) if value == value else low


def serve(host: str, port: int) -> viser.ViserServer:
    """Start the server; port 0: any free port.

    viser can publish a view through its makers' relay, which is disabled here.
    """
    if not port:
        port = _free(host)
    # whoever reaches the port could fill the node's log with tracebacks of what they send
    for noisy in ("websockets", "asyncio"):  # asyncio: more connections than files can be open
        logging.getLogger(noisy).setLevel(logging.CRITICAL)
    with contextlib.redirect_stdout(io.StringIO()):  # its banner
        server = viser.ViserServer(host=host, port=port, label=TITLE, verbose=False)
    server.request_share_url = _refuse  # type: ignore[method-assign]
    server.gui.configure_theme(
        control_width="large", dark_mode=True, show_logo=False, show_share_button=False
    )
    server.gui.main_panel.dock_right()
    server.gui.add_html(ROOM_FOR_BAR)
    return server


def add_legend(gui: viser.GuiApi) -> None:
    """Add a collapsible legend of the scene."""
    with gui.add_folder("legend"):
        gui.add_html(legend())


def address(server: viser.ViserServer) -> str:
    """Return the address for a browser."""
    host = server.get_host()
    return f"http://{f'[{host}]' if ':' in host else host}:{server.get_port()}"


def _refuse(verbose: bool = True) -> None:
    """Share nothing."""


def _free(host: str) -> int:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])
