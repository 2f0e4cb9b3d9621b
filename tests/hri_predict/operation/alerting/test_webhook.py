"""Webhooks against a real HTTP server."""

import hashlib
import hmac
import json
import re
import socket
import time

import pytest

from hri_predict.operation.alerting.sender import SendError
from hri_predict.operation.alerting.webhook import WebhookHook, WebhookSender, retry_after_s
from tests.hri_predict.operation.alerting.servers import (
    IN_BUFFERS,
    alert,
    flooding_server,
    place,
    server_tls,
    silent_server,
    web_server,
)


def sender(folder, url, **settings):
    return WebhookSender(WebhookHook(kind="webhook", url=url, **settings), place(folder))


def test_the_alert_is_posted_as_json(tmp_path):
    with web_server() as server:
        assert sender(tmp_path, server.url + "/a?b=c").send(alert(), 3) == "HTTP status 200"
    ((path, headers, body),) = server.got
    assert path == "/a?b=c"
    assert headers["Content-Type"] == "application/json"
    assert "Authorization" not in headers
    got = json.loads(body)
    assert (got["cell"], got["robot"], got["level"], got["more_changes"]) == (
        "cell7",
        "arm",
        "stop",
        3,
    )
    assert got["at"] == "2026-03-01T14:03:07.123+00:00"


def test_token_and_signature_come_from_a_file_and_the_environment(tmp_path, monkeypatch):
    (tmp_path / "token").write_text("hunter2\n")
    monkeypatch.setenv("SIGN_KEY", "swordfish")
    with web_server() as server:
        sender(tmp_path, server.url, token_file="token", sign_key_env="SIGN_KEY").send(alert(), 0)
    ((_, headers, body),) = server.got
    assert headers["Authorization"] == "Bearer hunter2"
    found = re.fullmatch(r"t=(\d+),v1=([0-9a-f]{64})", headers["X-Hri-Signature"])
    assert found
    seconds, tag = found.groups()
    assert abs(int(seconds) - time.time()) < 60
    mine = hmac.new(b"swordfish", seconds.encode() + b"." + body, hashlib.sha256)
    assert mine.hexdigest() == tag


def test_the_address_may_be_a_secret_itself(tmp_path):
    with web_server() as server:
        (tmp_path / "url").write_text(server.url + "/services/T0/B0/secret")
        settings = WebhookHook(kind="webhook", url_file="url")
        WebhookSender(settings, place(tmp_path)).send(alert(), 0)
    assert server.got[0][0] == "/services/T0/B0/secret"
    assert settings.label == "webhook url"


@pytest.mark.parametrize(
    ("status", "permanent"),
    [(302, True), (307, True), (404, True), (401, True), (429, False), (408, False), (503, False)],
)
def test_a_refusal_says_its_status_and_whether_to_try_again(status, permanent, tmp_path):
    with web_server() as server:
        server.statuses = [status]
        with pytest.raises(SendError, match=f"HTTP status {status}") as error:
            sender(tmp_path, server.url).send(alert(), 0)
    assert error.value.permanent is permanent
    assert len(server.got) == 1  # no redirect was followed


def test_the_certificate_is_checked(tmp_path):
    with web_server(server_tls(tmp_path)) as server:
        port = server.server_address[1]
        good = f"https://localhost:{port}/"
        with pytest.raises(SendError, match="certificate is not trusted"):
            sender(tmp_path, good).send(alert(), 0)
        with pytest.raises(SendError, match="certificate is not trusted"):  # another name
            sender(tmp_path, f"https://127.0.0.1:{port}/", ca_file="server.pem").send(alert(), 0)
        assert server.got == []
        sender(tmp_path, good, ca_file="server.pem").send(alert(), 0)
        assert len(server.got) == 1


def test_nobody_there_is_said(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # nobody listens there
        url = f"http://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(SendError, match="Connection refused") as error:
            sender(tmp_path, url).send(alert(), 0)
    assert not error.value.permanent


@pytest.mark.parametrize("word", [b"", b"x", b"HTTP/1.1 100 Continue\r\n\r\n"])
def test_a_server_that_never_comes_to_an_end_is_left(word, tmp_path):
    with silent_server(word) as port:
        begun = time.monotonic()
        with pytest.raises(SendError):
            sender(tmp_path, f"http://127.0.0.1:{port}", timeout_s=0.5).send(alert(), 0)
        assert time.monotonic() - begun < 5  # ten times the limit: a busy machine


@pytest.mark.parametrize(
    ("first", "then"),
    [
        (b"", b"HTTP/1.1 100 Continue\r\n\r\n" * 1000),
        (b"HTTP/1.1 200 OK\r\n", b"X: " + b"y" * 60_000 + b"\r\n"),
        (b"HTTP/1.1 500 no\r\n\r\n", b"z" * 65_536),
    ],
)
def test_a_server_that_sends_without_an_end_is_left_before_the_time_is_over(first, then, tmp_path):
    with flooding_server(first, then) as (port, taken):
        begun = time.monotonic()
        with pytest.raises(SendError):
            sender(tmp_path, f"http://127.0.0.1:{port}", timeout_s=30).send(alert(), 0)
        assert time.monotonic() - begun < 15
        assert taken[0] < IN_BUFFERS


def test_a_time_limit_is_called_so(tmp_path):
    with silent_server() as port, pytest.raises(SendError, match="no answer in time"):
        sender(tmp_path, f"http://127.0.0.1:{port}", timeout_s=0.2).send(alert(), 0)


def test_what_is_no_http_is_no_delivery(tmp_path):
    with (
        silent_server(b"SSH-2.0-x\r\n") as port,
        pytest.raises(SendError, match="not an HTTP server"),
    ):
        sender(tmp_path, f"http://127.0.0.1:{port}", timeout_s=2).send(alert(), 0)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("120", 120.0),
        (" 7 ", 7.0),
        ("Thu, 01 Jan 1970 00:01:40 GMT", 60.0),  # 100 s, asked at 40 s
        ("Thu, 01 Jan 1970 00:00:00 GMT", 0.0),
        ("soon", None),
        ("-5", None),
        ("9" * 400, 999_999_999.0),
        (None, None),
    ],
)
def test_retry_after_is_a_number_or_a_date(text, seconds):
    assert retry_after_s(text, 40.0) == seconds


def test_a_server_that_asks_to_wait_is_obeyed(tmp_path):
    with web_server() as server:
        server.statuses, server.headers = [503], {"Retry-After": "90"}
        with pytest.raises(SendError, match="requests a wait of 90 s") as error:
            sender(tmp_path, server.url).send(alert(), 0)
    assert error.value.again_s == 90.0
