"""The kinds of hooks: settings and sender of each, by name."""

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from hri_predict.base.errors import ConfigError
from hri_predict.operation.alerting.command import CommandHook, CommandSender
from hri_predict.operation.alerting.hook import Hook
from hri_predict.operation.alerting.mail import MailHook, MailSender
from hri_predict.operation.alerting.mqtt import MqttHook, MqttSender
from hri_predict.operation.alerting.sender import Place, Sender
from hri_predict.operation.alerting.settings import HookSettings
from hri_predict.operation.alerting.syslog import SyslogHook, SyslogSender
from hri_predict.operation.alerting.webhook import WebhookHook, WebhookSender

AnyHook = Annotated[
    CommandHook | WebhookHook | MqttHook | MailHook | SyslogHook, Field(discriminator="kind")
]
_SENDERS: dict[type[HookSettings], Any] = {
    CommandHook: CommandSender,
    WebhookHook: WebhookSender,
    MqttHook: MqttSender,
    MailHook: MailSender,
    SyslogHook: SyslogSender,
}


def sender_of(settings: HookSettings, place: Place) -> Sender:
    """Return the sender of a hook's alerts; open no connection.

    Raises:
        ConfigError: a secret, a certificate or a package is missing.
    """
    try:
        sender: Sender = _SENDERS[type(settings)](settings, place)
    except ConfigError as error:
        raise ConfigError(f"alert hook {settings.label}: {error}") from error
    return sender


def hooks_of(settings: Sequence[HookSettings], place: Place) -> list[Hook]:
    """The hooks, not yet started.

    Raises:
        ConfigError: one cannot be used.
    """
    return [Hook(each, sender_of(each, place)) for each in settings]
