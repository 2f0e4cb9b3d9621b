"""E-mail against a real SMTP server (aiosmtpd)."""

import email.policy
import json
import time
from contextlib import contextmanager
from email.parser import BytesParser

import pytest

from hri_predict.operation.alerting.mail import MailHook, MailSender
from hri_predict.operation.alerting.sender import SendError
from tests.hri_predict.operation.alerting.servers import (
    IN_BUFFERS,
    alert,
    flooding_server,
    place,
    server_tls,
    silent_server,
)
from tests.waiting import free_port

controller = pytest.importorskip("aiosmtpd.controller", reason="needs aiosmtpd (the extra dev)")
smtp = pytest.importorskip("aiosmtpd.smtp", reason="needs aiosmtpd (the extra dev)")


class Mailbox:
    """Keeps what comes, and refuses some recipients."""

    def __init__(self, refused=(), status=550):
        self.got, self.refused, self.status = [], refused, status

    async def handle_RCPT(self, _server, _session, envelope, address, _options):
        if address in self.refused:
            return f"{self.status} no"
        envelope.rcpt_tos.append(address)
        return "250 OK"

    async def handle_DATA(self, _server, session, envelope):
        self.got.append((session.ssl is not None, envelope))
        return "250 taken"


def authenticate(_server, _session, _envelope, _mechanism, login):
    good = login.login == b"cell" and login.password == b"hunter2"
    return smtp.AuthResult(success=good, handled=False)


@contextmanager
def mail_server(mailbox, folder, *, tls=True, port=None):
    settings = {}
    if tls:
        settings = {"tls_context": server_tls(folder), "require_starttls": True}
        settings |= {"authenticator": authenticate, "auth_require_tls": True}
    running = controller.Controller(
        mailbox, hostname="127.0.0.1", port=port or free_port(), **settings
    )
    running.start()
    try:
        yield running.port
    finally:
        running.stop()


def sender(folder, port, **settings):
    whole = {
        "kind": "email",
        "host": "localhost",
        "port": port,
        "sender": "cell@plant.example",
        "recipients": ["shift@plant.example", "boss@plant.example"],
        "ca_file": "server.pem",
    }
    return MailSender(MailHook(**(whole | settings)), place(folder))


def test_a_letter_arrives_by_starttls_with_a_password(tmp_path):
    (tmp_path / "password").write_text("hunter2\n")
    mailbox = Mailbox()
    with mail_server(mailbox, tmp_path) as port:
        mine = sender(tmp_path, port, username="cell", password_file="password")
        assert mine.send(alert(detail="Zoë's hand is 0.3 m away"), 3) == "accepted by the server"
    ((by_tls, envelope),) = mailbox.got
    assert by_tls
    assert envelope.mail_from == "cell@plant.example"
    assert envelope.rcpt_tos == ["shift@plant.example", "boss@plant.example"]
    letter = BytesParser(policy=email.policy.default).parsebytes(envelope.content)
    assert letter["Subject"] == "[cell7] arm: clear -> stop; 3 more changes before"
    assert letter["Date"].datetime.isoformat() == "2026-03-01T14:03:07+00:00"
    text = letter.get_content()
    assert "Zoë's hand is 0.3 m away" in text
    assert json.loads(text[text.index("{") :])["level"] == "stop"


def test_a_wrong_password_is_said_without_it(tmp_path, monkeypatch):
    monkeypatch.setenv("MAIL_PASSWORD", "hunter3")
    with mail_server(Mailbox(), tmp_path) as port:
        mine = sender(tmp_path, port, username="cell", password_env="MAIL_PASSWORD")
        with pytest.raises(SendError, match="user name or password is wrong") as error:
            mine.send(alert(), 0)
    assert error.value.permanent
    assert "hunter3" not in str(error.value)


def test_the_certificate_is_checked(tmp_path):
    with (
        mail_server(Mailbox(), tmp_path) as port,
        pytest.raises(SendError, match="certificate is not trusted"),
    ):
        sender(tmp_path, port, ca_file=None).send(alert(), 0)


def test_no_letter_goes_out_in_clear_where_starttls_is_asked(tmp_path):
    mailbox = Mailbox()
    server_tls(tmp_path)
    with mail_server(mailbox, tmp_path, tls=False) as port:
        with pytest.raises(SendError, match="STARTTLS"):
            sender(tmp_path, port).send(alert(), 0)
        assert mailbox.got == []
        sender(tmp_path, port, security="none").send(alert(), 0)
    assert [by_tls for by_tls, _ in mailbox.got] == [False]


@pytest.mark.parametrize(("status", "permanent"), [(550, True), (450, False)])
def test_refused_recipients_are_said(status, permanent, tmp_path):
    both = ["shift@plant.example", "boss@plant.example"]
    with mail_server(Mailbox(both, status), tmp_path, tls=False) as port:
        with pytest.raises(SendError, match=f"all recipients: SMTP status {status}") as error:
            sender(tmp_path, port, security="none", ca_file=None).send(alert(), 0)
        assert error.value.permanent is permanent


def test_one_refused_recipient_is_named_and_the_others_get_it_once(tmp_path):
    mailbox = Mailbox(["boss@plant.example"])
    with (
        mail_server(mailbox, tmp_path, tls=False) as port,
        pytest.raises(SendError, match=r"refuses for boss@plant\.example") as error,
    ):
        sender(tmp_path, port, security="none", ca_file=None).send(alert(), 0)
    assert error.value.permanent
    assert len(mailbox.got) == 1


@pytest.mark.parametrize("word", [b"", b"220-wait\r\n"])
def test_a_server_that_never_comes_to_an_end_is_left(word, tmp_path):
    with silent_server(word) as port:
        begun = time.monotonic()
        mine = sender(tmp_path, port, security="none", ca_file=None, timeout_s=0.5)
        with pytest.raises(SendError):
            mine.send(alert(), 0)
        assert time.monotonic() - begun < 5  # ten times the limit: a busy machine


def test_a_server_that_greets_without_an_end_is_left_before_the_time_is_over(tmp_path):
    with flooding_server(b"", b"220-" + b"z" * 4000 + b"\r\n") as (port, taken):
        begun = time.monotonic()
        mine = sender(tmp_path, port, security="none", ca_file=None, timeout_s=30)
        with pytest.raises(SendError, match="more than 65536 bytes"):
            mine.send(alert(), 0)
        assert time.monotonic() - begun < 15
        assert taken[0] < IN_BUFFERS


def test_a_letter_arrives_by_tls_from_the_first_byte(tmp_path):
    mailbox = Mailbox()
    running = controller.Controller(
        mailbox, hostname="127.0.0.1", port=free_port(), ssl_context=server_tls(tmp_path)
    )
    running.start()
    try:
        mine = sender(tmp_path, running.port, security="tls")
        assert mine.send(alert(), 0) == "accepted by the server"
        with pytest.raises(SendError, match="certificate is not trusted"):
            sender(tmp_path, running.port, security="tls", ca_file=None).send(alert(), 0)
    finally:
        running.stop()
    assert len(mailbox.got) == 1
