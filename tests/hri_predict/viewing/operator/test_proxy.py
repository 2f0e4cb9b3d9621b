"""The operator's page behind a proxy: under the proxy's name and path, and no other."""

import json
import threading
import time

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.cli.screens.options import published
from hri_predict.viewing.operator.server import Server
from hri_predict.viewing.operator.state import State
from tests.hri_predict.viewing.operator.test_page import ask, picture

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
