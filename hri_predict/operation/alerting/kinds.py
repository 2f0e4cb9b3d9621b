"""The kinds of hooks, one row each."""

from collections.abc import Sequence
from typing import Annotated, get_args

from pydantic import Field

from hri_predict.base.errors import ConfigError
from hri_predict.operation.alerting.command import CommandHook
from hri_predict.operation.alerting.hook import Hook
from hri_predict.operation.alerting.mail import MailHook
from hri_predict.operation.alerting.mqtt import MqttHook
from hri_predict.operation.alerting.sender import HookContext, Sender
from hri_predict.operation.alerting.settings import HookSettings
from hri_predict.operation.alerting.syslog import SyslogHook
from hri_predict.operation.alerting.webhook import WebhookHook

_Kinds = (
    CommandHook
    | WebhookHook
    | MqttHook
    | MailHook
    | SyslogHook
)  # fmt: skip
AnyHook = Annotated[_Kinds, Field(discriminator="kind")]
KINDS = tuple(get_args(hook.model_fields["kind"].annotation)[0] for hook in get_args(_Kinds))
"""Their names."""


def sender_of(settings: HookSettings, place: HookContext) -> Sender:
    """Return the sender of a hook's alerts without opening a connection.

    Raises:
        ConfigError: a secret, a certificate or a package is missing.
    """
    try:
        return settings.create_sender(place)
    except ConfigError as error:
        raise ConfigError(f"alert hook {settings.label}: {error}") from error


def hooks_of(settings: Sequence[HookSettings], place: HookContext) -> list[Hook]:
    """The hooks, not yet started.

    Raises:
        ConfigError: one cannot be used.
    """
    return [Hook(each, sender_of(each, place)) for each in settings]
