"""The operator's page behind a proxy: under the proxy's name and path, and no other."""

import json
import re
import shutil
import subprocess
import threading
import time
from importlib import resources

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.cli.screens.options import published
from hri_predict.viewing.operator.server import Published, Server
from hri_predict.viewing.operator.state import State
from tests.hri_predict.viewing.operator.test_page import ask, picture

NODE = shutil.which("node")
PAGES = resources.files("hri_predict.viewing.operator")
URL = "https://plant.example/cells/7"


@pytest.fixture
def server():
    made = Server(host="127.0.0.1", port=0, state=State(), request_s=0.5, urls=[URL])
    threading.Thread(target=made.serve_forever, args=(0.05,), daemon=True).start()
    yield made
    made.state.end()
    made.shutdown()
    made.server_close()


@pytest.mark.parametrize("prefix", ["", "/cells/7"])  # a proxy may strip it or not
@pytest.mark.parametrize("path", ["/", "/page.js", "/page.css", "/common.js"])
def test_the_page_comes_under_the_proxys_name_and_path(server, prefix, path):
    answer, body = ask(server, path=prefix + path, Host="plant.example")
    assert answer.status == 200
    assert b'="/' not in body  # names from the root would miss the prefix
    assert b'("/' not in body


def test_without_its_last_slash_the_path_is_completed(server):
    answer, _ = ask(server, path="/cells/7", Host="plant.example")
    assert (answer.status, answer.headers["Location"]) == (308, "/cells/7/")


def test_an_alert_is_marked_as_read_through_the_proxy(server):
    server.state.take(picture("STOP"), time.monotonic())
    said = json.dumps({"number": 1})
    for host in ("plant.example", "127.0.0.1"):  # a proxy may keep the name or not
        headers = {"Host": host, "Origin": "https://plant.example"}
        assert ask(server, "POST", "/cells/7/acknowledge", said, **headers)[0].status == 204


@pytest.mark.parametrize(
    ("url", "origin"),
    [
        ("https://plant.example:443/cells/7", "https://plant.example"),
        ("http://Plant.example:80", "http://plant.example"),
        ("https://[fd00::443]:443", "https://[fd00::443]"),
        ("https://[fd00::443]", "https://[fd00::443]"),
        ("https://plant.example:80", "https://plant.example:80"),
        ("https://plant.example:8443/x", "https://plant.example:8443"),
    ],
)
def test_the_origin_is_what_browsers_state(url, origin):
    """They leave out the usual port, so that marking an alert as read was refused."""
    assert Published([url]).origins == {origin}


@pytest.mark.skipif(NODE is None, reason="no node")
@pytest.mark.parametrize(
    ("answer", "shown"),
    [
        ("Promise.resolve({ok: true, status: 204})", ""),
        ("Promise.resolve({ok: false, status: 403})", "start it with --operator-url"),
        ("Promise.resolve({ok: false, status: 502})", "the answer was 502"),
        ("Promise.reject(new TypeError())", "no connection"),
    ],
)
def test_the_page_says_that_an_alert_was_not_marked_as_read(answer, shown):
    script = PAGES.joinpath("common.js").read_text(encoding="utf-8")
    (acknowledge,) = re.findall(r"function acknowledge\(which\) \{.*?\n\}", script, re.DOTALL)
    asked = f"""
        const refused = {{}}, byId = (id) => id === "refused" ? refused : null;
        globalThis.fetch = () => {answer};
        {acknowledge}
        acknowledge({{number: 1}}).then(() => console.log(refused.textContent));
    """
    said = subprocess.run([str(NODE), "-e", asked], capture_output=True, check=True, text=True)
    assert said.stdout.strip().endswith(shown)
    assert said.stdout.startswith("Not marked as read: ") == bool(shown)


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example", "X_Forwarded_Host": "plant.example"},
        {"Host": "evil.example", "Forwarded": "host=plant.example"},
        {"Host": "plant.example.evil.example"},
        {"Host": "plant.example", "Origin": "https://evil.example"},
        {"Host": "127.0.0.1", "Origin": "http://plant.example"},
    ],
)
def test_others_are_refused_whatever_they_say_they_forward(server, headers):
    said = json.dumps({"number": 1})
    assert ask(server, "POST", "/cells/7/acknowledge", said, **headers)[0].status == 403


@pytest.mark.parametrize("path", ["/cells/8/", "/cells/77", "/cells/7/none", "/cells"])
def test_other_paths_are_not_there(server, path):
    assert ask(server, path=path, Host="plant.example")[0].status == 404


@pytest.mark.parametrize(
    "url", ["plant.example", "ftp://plant.example", "https://", "https://a@b/", "https://b/?x", ""]
)
def test_a_wrong_address_is_one_line(url):
    with pytest.raises(ConfigError, match=r"--operator-url .*write it as https://HOST"):
        published(8091, [url])
    with pytest.raises(ConfigError, match="without --operator"):
        published(None, [URL])
    assert published(8091, [URL]) == (URL,)
