"""A real browser without a window, driven by its DevTools: for tests and for pictures of pages."""

import base64
import itertools
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path
from types import TracebackType
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
WAIT_S = 60.0
_FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
]


class Browser:
    """One page of Debian's chromium; use it as a context manager."""

    def __init__(self, width: int = 1280, height: int = 800) -> None:
        from websockets.sync.client import connect

        assert CHROMIUM is not None
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        size = f"--window-size={width},{height}"
        self._process = subprocess.Popen(
            [CHROMIUM, *_FLAGS, size, f"--user-data-dir={self._folder.name}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            page = self._page()
            self._socket = connect(page, max_size=None, proxy=None)
        except BaseException:
            self._process.kill()
            raise
        self._numbers = itertools.count(1)
        self.console: list[str] = []
        self.requested: list[str] = []
        self.ask("Runtime.enable")
        self.ask("Network.enable")

    def _page(self) -> str:
        """The address of the page's DevTools."""
        said = Path(self._folder.name, "DevToolsActivePort")
        port = wait_for(lambda: said.exists() and said.read_text().split("\n")[0])

        def first() -> Any:
            opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
            with opener.open(f"http://127.0.0.1:{port}/json", timeout=WAIT_S) as answer:
                pages = [each for each in json.load(answer) if each["type"] == "page"]
            return pages and pages[0]["webSocketDebuggerUrl"]

        return str(wait_for(first))

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        """One command of the DevTools protocol, and its answer."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while True:
            answer = json.loads(self._socket.recv(timeout=WAIT_S))
            if answer.get("method") == "Runtime.exceptionThrown":
                self.console.append(json.dumps(answer["params"]["exceptionDetails"])[:500])
            if answer.get("method") == "Network.requestWillBeSent":
                self.requested.append(answer["params"]["request"]["url"])
            if answer.get("id") == number:
                assert "error" not in answer, answer["error"]
                result: dict[str, Any] = answer["result"]
                return result

    def open(self, url: str) -> None:
        """Go to a page."""
        self.ask("Page.enable")
        self.ask("Page.navigate", url=url)

    def evaluate(self, script: str) -> Any:
        """The value of a JavaScript expression in the page."""
        result = self.ask("Runtime.evaluate", expression=script, returnByValue=True)
        return result["result"].get("value")

    def text(self) -> str:
        """All text that the page shows."""
        return str(self.evaluate("document.body ? document.body.innerText : ''"))

    def wait_for_text(self, text: str, within_s: float = WAIT_S) -> None:
        """Wait until the page shows a text.

        Raises:
            TimeoutError: it does not.
        """
        try:
            wait_for(lambda: text in self.text(), within_s)
        except TimeoutError:
            raise TimeoutError(f"{text!r} is not in {self.text()!r}") from None

    def box(self, element: str) -> tuple[float, float, float, float]:
        """Left, top, right, bottom of an element, given as a JavaScript expression."""
        rect = f"(r => [r.left, r.top, r.right, r.bottom])(({element}).getBoundingClientRect())"
        left, top, right, bottom = self.evaluate(rect)
        return left, top, right, bottom

    def click(self, x: float, y: float) -> None:
        """Click at a place of the page, with a mouse."""
        for kind in ("mousePressed", "mouseReleased"):
            where = {"x": x, "y": y, "button": "left", "clickCount": 1}
            self.ask("Input.dispatchMouseEvent", type=kind, **where)

    def press(self, letter: str) -> None:
        """Press a letter's key."""
        code = ord(letter.upper())
        key = {"key": letter.lower(), "code": f"Key{letter.upper()}"}
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, windowsVirtualKeyCode=code, **key)

    def screenshot(self) -> bytes:
        """The page as PNG."""
        return base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"])

    def __enter__(self) -> "Browser":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._socket.close()
        self._process.terminate()
        self._process.wait(10)
        self._folder.cleanup()


def wait_for(condition: Any, within_s: float = WAIT_S) -> Any:
    """The first true value of ``condition``, asked again and again.

    Raises:
        TimeoutError: it does not become true.
    """
    end_s = time.monotonic() + within_s
    while time.monotonic() < end_s:
        if value := condition():
            return value
        time.sleep(0.1)
    raise TimeoutError
