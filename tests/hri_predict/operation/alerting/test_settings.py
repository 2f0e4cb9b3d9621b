"""Mistakes in ``alerts.to`` are one line with the remedy; no secret is in any line."""

import os

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.operation.alerting.kinds import sender_of
from hri_predict.operation.monitoring.alerts import AlertSettings
from tests.hri_predict.operation.alerting.servers import place

WEBHOOK = {"kind": "webhook", "url": "https://hooks.example/alerts"}
MQTT = {"kind": "mqtt", "host": "broker.example"}
MAIL = {
    "kind": "email",
    "host": "mail.example",
    "sender": "cell@plant.example",
    "recipients": ["shift@plant.example"],
}
SYSLOG = {"kind": "syslog", "host": "log.example"}


def hook(data):
    (made,) = validated(AlertSettings, {"to": [data]}, "cell.yaml: alerts").to
    return made


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"kind": "pager"}, ["alerts: to.0", "'webhook', 'mqtt'"]),
        (WEBHOOK | {"url": "ftp://hooks.example/"}, ["must begin with https://"]),
        (WEBHOOK | {"url": "file:///etc/passwd"}, ["must begin with https://"]),
        (WEBHOOK | {"url": "https:///path"}, ["names no host"]),
        (WEBHOOK | {"url": "https://h:x/"}, ["expected https://HOST/PATH"]),
        (WEBHOOK | {"url": "https://h/ä"}, ["printable ASCII"]),
        (WEBHOOK | {"url_env": "URL"}, ["give one of: url, url_file, url_env"]),
        (WEBHOOK | {"token_file": "a", "token_env": "B"}, ["leave one out"]),
        (WEBHOOK | {"levels": ["halt"]}, ["to.0.levels.0", "'stop'"]),
        (WEBHOOK | {"debonce_s": 1}, ["did you mean 'debounce_s'?"]),
        (WEBHOOK | {"rate_per_minute": 0}, ["rate_per_minute"]),
        (MQTT | {"levels": ["stop"]}, ["levels: not allowed with kind mqtt"]),
        (MQTT | {"topic": "plant/#"}, ["topic"]),
        (MQTT | {"password_file": "a"}, ["needs 'username'"]),
        (MQTT | {"host": "mqtt://broker"}, ["host"]),
        (MAIL | {"recipients": ["a@b.example\nBcc: c@d.example"]}, ["recipients.0"]),
        (MAIL | {"recipients": []}, ["recipients"]),
        (MAIL | {"username": "cell"}, ["go together"]),
        (
            MAIL | {"username": "cell", "password_file": "a", "security": "none"},
            ["would send the password unencrypted"],
        ),
        (SYSLOG | {"protocol": "unix"}, ["needs 'path'"]),
        ({"kind": "syslog"}, ["needs 'host'"]),
        (SYSLOG | {"ca_file": "a.pem"}, ["no effect without protocol: tls"]),
        ({"kind": "command", "command": []}, ["command"]),
    ],
)
def test_a_mistake_is_one_line_with_the_remedy(data, words):
    with pytest.raises(ConfigError) as error:
        hook(data)
    for word in words:
        assert word in str(error.value)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    "data",
    [
        WEBHOOK | {"url": "https://user:hunter2@hooks.example/"},
        WEBHOOK | {"token": "hunter2"},
        WEBHOOK | {"sign_key": "hunter2"},
        MQTT | {"username": "cell", "password": "hunter2"},
        MAIL | {"username": "cell", "password": "hunter2"},
    ],
)
def test_a_secret_in_the_configuration_is_refused_and_not_repeated(data):
    with pytest.raises(ConfigError, match="recordings contain") as error:
        hook(data)
    assert "_file" in str(error.value)
    assert "hunter2" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot be read: No such file"),
        ("", ": empty"),
        ("two\nlines", "not a line"),
        ("ä", "not a line"),
        ("x" * 5000, "not a line"),
    ],
)
def test_a_secret_that_cannot_be_used_is_not_repeated(content, words, tmp_path):
    if content is not None:
        (tmp_path / "token").write_text(content)
    with pytest.raises(ConfigError, match=words) as error:
        sender_of(hook(WEBHOOK | {"token_file": "token"}), place(tmp_path))
    assert "alert hook webhook hooks.example: token_file" in str(error.value)
    assert not content or content not in str(error.value)


def test_a_missing_environment_variable_is_named(tmp_path, monkeypatch):
    monkeypatch.delenv("HOOK_TOKEN", raising=False)
    with pytest.raises(ConfigError, match="no environment variable 'HOOK_TOKEN'; set it"):
        sender_of(hook(WEBHOOK | {"token_env": "HOOK_TOKEN"}), place(tmp_path))


def test_a_secret_that_others_can_read_is_told(tmp_path, caplog):
    (tmp_path / "token").write_text("hunter2\n")
    os.chmod(tmp_path / "token", 0o644)
    sender_of(hook(WEBHOOK | {"token_file": "token"}), place(tmp_path))
    assert "other users can read it" in caplog.text
    assert "hunter2" not in caplog.text


@pytest.mark.parametrize(
    ("data", "word"),
    [
        (WEBHOOK | {"url": "http://hooks.example/"}, "use https"),
        (MQTT | {"tls": False}, "use tls: true"),
        (MAIL | {"security": "none"}, "use security: starttls"),
        (SYSLOG, "use protocol: tls"),
    ],
)
def test_what_goes_out_without_tls_is_noted_but_not_to_the_machine_itself(data, word):
    (note,) = hook(data).notes
    assert word in note
    for local in ("localhost", "127.0.0.1", "::1"):
        url = f"http://[{local}]/" if ":" in local else f"http://{local}/"
        there = {"url": url} if "url" in data else {"host": local}
        assert hook(data | there).notes == []


def test_the_path_of_a_webhook_is_not_in_its_name():
    assert hook(WEBHOOK | {"url": "https://hooks.example/T0/secret"}).label == (
        "webhook hooks.example"
    )


def test_a_missing_certificate_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"ca_file .*plant.pem: no such file; check the path"):
        sender_of(hook(WEBHOOK | {"ca_file": "plant.pem"}), place(tmp_path))
    (tmp_path / "plant.pem").write_text("nothing")
    with pytest.raises(ConfigError, match="no certificate in PEM format"):
        sender_of(hook(WEBHOOK | {"ca_file": "plant.pem"}), place(tmp_path))
