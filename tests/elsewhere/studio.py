"""Shows a recording in Foxglove Studio, in a real browser: ``make elsewhere`` fetches the program.

``python -m tests.elsewhere.studio RECORDING PICTURE`` makes a picture.
"""

import contextlib
import re
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from tests.browser import Browser

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
MODULES = ROOT / "build" / "elsewhere" / "node_modules"
LAYOUT = ROOT / "docs" / "foxglove-layout.json"
MOMENT = "1970-01-01T00:00:07.200000000Z"
"""In the demo: the person comes near, and the robot still moves."""
_TIDY = """
document.querySelectorAll("[data-testid=CloseIcon]").forEach(e => e.closest("button").click());
document.querySelector("button").click();  // the list of topics
"""


class _Pages(SimpleHTTPRequestHandler):
    """Gives files, also parts of them: Studio reads a recording by parts."""

    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        path = Path(self.translate_path(self.path))
        if not path.is_file():
            self.send_error(404)
            return
        size = path.stat().st_size
        asked = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        first = int(asked[1]) if asked else 0
        last = min(int(asked[2]), size - 1) if asked and asked[2] else size - 1
        self.send_response(206 if asked else 200)
        self.send_header("Content-Type", self.guess_type(path))
        self.send_header("Content-Length", str(last - first + 1))
        self.send_header("Accept-Ranges", "bytes")
        if asked:
            self.send_header("Content-Range", f"bytes {first}-{last}/{size}")
        self.end_headers()
        with path.open("rb") as file, contextlib.suppress(ConnectionError):  # it asks anew
            file.seek(first)
            self.wfile.write(file.read(last + 1 - first))

    def log_message(self, *_: Any) -> None:
        """Say nothing."""


@contextlib.contextmanager
def studio(recording: Path, at: str) -> Iterator[Browser]:
    """A browser that shows Studio with this recording at this moment, and our layout."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copy2(HERE / "studio.html", folder / "index.html")
        shutil.copy2(LAYOUT, folder / "layout.json")
        shutil.copy2(recording, folder / "recording.mcap")
        (folder / "node_modules").symlink_to(MODULES)

        def pages(*args: Any) -> _Pages:
            return _Pages(*args, directory=name)

        server = ThreadingHTTPServer(("127.0.0.1", 0), pages)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        here = f"http://127.0.0.1:{server.server_port}/"
        try:
            with Browser(1500, 900) as browser:
                file = {"ds": "remote-file", "ds.url": f"{here}recording.mcap"}
                asked = urlencode({**file, "layoutId": "ours", "time": at})
                browser.open(f"{here}index.html?{asked}")
                yield browser
        finally:
            server.shutdown()
            server.server_close()


def picture(browser: Browser) -> bytes:
    """What is shown, without the list of topics, as PNG."""
    browser.evaluate(_TIDY)
    time.sleep(5.0)  # software draws about one frame a second
    return browser.screenshot()


def main(recording: str, out: str) -> None:
    """Make a picture of a recording of the demo."""
    with studio(Path(recording), MOMENT) as browser:
        browser.wait_for_text("level_number")
        time.sleep(5.0)  # plots of the whole file
        Path(out).write_bytes(picture(browser))


if __name__ == "__main__":
    main(*sys.argv[1:])
