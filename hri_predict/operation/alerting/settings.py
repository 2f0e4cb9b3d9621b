"""Settings common to all alert hooks; each kind derives its settings from these."""

import ipaddress
import logging
import os
import stat
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import refuse_named_pipe
from hri_predict.base.settings import Settings
from hri_predict.operation.alerting.alert import Alert, AnyAlert, ZoneAlert
from hri_predict.operation.alerting.sender import HookContext, Sender

LevelName = Literal["unknown", "clear", "warn", "slow", "stop", "fault"]
Text = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$")]
Host = Annotated[str, Field(pattern=r"^[A-Za-z0-9._:-]{1,253}$")]
"""A name, an IPv4 or an IPv6 address, without brackets."""


class HookSettings(Settings):
    """An entry of ``alerts.to``: the alerts that are sent there, and their maximum rate."""

    secrets: ClassVar[tuple[str, ...]] = ()
    """Secrets of this kind: each ``KEY`` for which ``KEY_file`` and ``KEY_env`` exist."""

    kind: str
    name: Text | None = Field(
        None, description="name in log and summary; default: kind and address"
    )
    levels: list[LevelName] | None = Field(
        None,
        min_length=1,
        description="only changes of a robot to one of these levels; default: all",
    )
    robots: list[str] | None = Field(None, description="only these robots; default: all")
    zones: list[str] | None = Field(None, description="only these named zones; default: all")
    debounce_s: float = Field(
        1.0,
        ge=0,
        le=3600,
        description="minimum time between two alerts of one robot or zone; the newest alert waits",
    )
    rate_per_minute: int = Field(
        30,
        ge=1,
        le=6000,
        description="maximum number of alerts in any minute; the newest alerts wait",
    )
    retry_s: float = Field(
        60.0,
        ge=0,
        le=3600,
        description="maximum time to deliver an alert; after that it is dropped and counted",
    )
    timeout_s: float = Field(5.0, ge=0.1, le=60, description="give up one attempt after this time")

    @property
    def where(self) -> str:
        """The receiver as text, without a secret."""
        raise NotImplementedError

    def create_sender(self, place: HookContext) -> Sender:
        """Create the sender of this hook; opens no connection.

        Raises:
            ConfigError: a secret, a certificate or a package is missing.
        """
        raise NotImplementedError

    @property
    def label(self) -> str:
        """Name in log and summary."""
        return self.name or f"{self.kind} {self.where}"

    @property
    def notes(self) -> list[str]:
        """Warnings of ``check``."""
        return []

    @property
    def stop_s(self) -> float:
        """Maximum time for which a stopping node waits for this hook."""
        return min(self.timeout_s, 2.0) + 0.5

    def wants(self, alert: AnyAlert) -> bool:
        """Whether this alert is sent to this hook."""
        if isinstance(alert, Alert):
            chosen = self.robots is None or alert.robot in self.robots
            return chosen and (self.levels is None or alert.level in self.levels)
        if isinstance(alert, ZoneAlert):
            return self.zones is None or alert.zone in self.zones
        return True

    def secret(self, key: str, base_dir: Path) -> str | None:
        """The secret under ``KEY_file`` or ``KEY_env``; ``None`` if neither is given.

        Raises:
            ConfigError: it cannot be used.
        """
        file, env = getattr(self, f"{key}_file"), getattr(self, f"{key}_env")
        return read_secret(key, file=file, env=env, base_dir=base_dir)

    @model_validator(mode="before")
    @classmethod
    def _no_literal_secret(cls, data: Any) -> Any:
        """Refuse secrets here, where the message shows only the keys of the block, not their
        values.
        """
        for key in cls.secrets if isinstance(data, dict) else ():
            if key in data and key not in cls.model_fields:
                raise ValueError(
                    f"{key}: secrets are not allowed in the configuration because recordings "
                    f"contain it; put it in a file and name that under {key}_file, or use {key}_env"
                )
        return data

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        for key in self.secrets:
            if None not in (getattr(self, f"{key}_file"), getattr(self, f"{key}_env")):
                raise ValueError(f"{key}_file and {key}_env are both given; leave one out")
        return self


SecretFile = Annotated[
    str | None,
    Field(
        min_length=1,
        description="file that holds the secret; relative to the configuration's folder",
    ),
]
CaFile = Annotated[
    str | None,
    Field(min_length=1, description="certificates (PEM) to trust instead of the system's"),
]
SecretVariable = Annotated[
    str | None,
    Field(
        pattern=r"^[A-Za-z_][A-Za-z0-9_]*$",
        description="environment variable that holds the secret",
    ),
]


def is_loopback(host: str) -> bool:
    """Whether this host is the machine itself: ``localhost`` or a loopback address."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


log = logging.getLogger(__name__)

MAX_BYTES = 4096


def read_secret(key: str, *, file: str | None, env: str | None, base_dir: Path) -> str | None:
    """Return the secret named by ``KEY_file`` or ``KEY_env``, without surrounding white space.

    Never from the configuration, whose text goes into every recording.

    Args:
        key: key of the setting, without ``_file`` or ``_env``.
        file: path, relative to ``base_dir``.
        env: name of an environment variable.
        base_dir: the configuration's folder.

    Raises:
        ConfigError: it is missing, empty, too long, or not one line of printable ASCII. The message
            never contains any part of it.
    """
    if env is not None:
        where, found = f"{key}_env", os.environ.get(env)
        if found is None:
            raise ConfigError(
                f"{where}: no environment variable '{env}'; set it, or use {key}_file"
            )
        secret = found.strip()
    elif file is not None:
        where, secret = f"{key}_file {base_dir / file}", _of_file(key, base_dir / file)
    else:
        return None
    if not secret:
        raise ConfigError(f"{where}: empty; put the secret there")
    if len(secret) > MAX_BYTES or not (secret.isascii() and secret.isprintable()):
        raise ConfigError(
            f"{where}: not a line of at most {MAX_BYTES} printable ASCII characters; "
            "put only the secret there"
        )
    return secret


def _of_file(key: str, path: Path) -> str:
    try:
        refuse_named_pipe(path)
        with path.open("rb") as stream:
            mode = os.fstat(stream.fileno()).st_mode
            text = stream.read(MAX_BYTES + 1).strip().decode("latin-1")
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = (error.strerror if isinstance(error, OSError) else None) or "no such path"
        raise ConfigError(f"{key}_file {path}: cannot be read: {reason}; check the path") from None
    if os.name == "posix" and mode & (stat.S_IRWXG | stat.S_IRWXO):
        log.warning("%s_file %s: other users can read it; run chmod 600 on it", key, path)
    return text
