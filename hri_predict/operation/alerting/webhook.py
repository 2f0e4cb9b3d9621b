"""Alerts through a webhook: each is an HTTP POST of JSON.

A redirect is not followed (it would carry the token elsewhere), and no proxy is used.
"""

import hashlib
import hmac
import http.client
import json
import time
from email.utils import parsedate_to_datetime
from typing import Annotated, Any, ClassVar, Literal, Self
from urllib.parse import SplitResult, urlsplit

from pydantic import Field, model_validator

from hri_predict.base.errors import ConfigError
from hri_predict.operation.alerting.alert import AnyAlert, payload
from hri_predict.operation.alerting.sender import (
    Answer,
    HookContext,
    Sender,
    SendError,
    cut_after,
    said,
    tls_context,
)
from hri_predict.operation.alerting.settings import (
    CaFile,
    HookSettings,
    SecretFile,
    SecretVariable,
    is_loopback,
)

_LATER = (408, 425, 429)
"""HTTP status codes after which a retry makes sense (RFC 9110, RFC 8470, RFC 6585)."""

Url = Annotated[str, Field(min_length=1, max_length=2000)]


class WebhookHook(HookSettings):
    """``kind: webhook``."""

    secrets: ClassVar[tuple[str, ...]] = ("token", "sign_key", "url")

    kind: Literal["webhook"] = Field(description="an HTTP POST of JSON")
    url: Url | None = Field(None, description="address to post to: http or https")
    url_file: SecretFile = None
    url_env: SecretVariable = None
    token_file: SecretFile = None
    token_env: SecretVariable = None
    sign_key_file: SecretFile = None
    sign_key_env: SecretVariable = None
    ca_file: CaFile = None

    @model_validator(mode="before")
    @classmethod
    def _url_is_right(cls, data: object) -> object:
        """Check before the fields are validated: an error message must not repeat the address."""
        url = data.get("url") if isinstance(data, dict) else None
        if isinstance(url, str):
            address_of(url)
        return data

    @model_validator(mode="after")
    def _one_url(self) -> Self:
        if (self.url, self.url_file, self.url_env).count(None) != 2:
            raise ValueError("give one of: url, url_file, url_env")
        return self

    def create_sender(self, place: HookContext) -> Sender:
        """See the base class."""
        return WebhookSender(self, place)

    @property
    def where(self) -> str:
        """Return the server only, because the path may be a secret."""
        if self.url is None:
            return self.url_file or f"${self.url_env}"
        return address_of(self.url).netloc

    @property
    def notes(self) -> list[str]:
        """Notes on what is sent without TLS."""
        if self.url is None:
            return []
        parts = address_of(self.url)
        if parts.scheme == "https" or is_loopback(parts.hostname or ""):
            return []
        secret = self.token_file or self.token_env
        return [
            f"http without TLS to {parts.hostname}: anyone on the network path can read and "
            "change alerts" + (", and the token" if secret else "") + "; use https"
        ]


def address_of(url: str) -> SplitResult:
    """Return the parts of a webhook's address.

    Raises:
        ValueError: it cannot be used; the message is one line with the remedy, without the address.
    """
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        raise ValueError("url: not a valid address; expected https://HOST/PATH") from None
    if not (url.isascii() and url.isprintable()) or " " in url:
        raise ValueError(
            "url: only printable ASCII without spaces is allowed; percent-encode "
            "other characters, such as %20"
        )
    if parts.scheme not in ("http", "https"):
        raise ValueError("url: must begin with https:// or http://")
    if not parts.hostname or port == 0:
        raise ValueError("url: names no host or port; write it as https://HOST/PATH")
    if "@" in parts.netloc:
        raise ValueError(
            "url: user and password are not allowed in the configuration because recordings "
            "contain it; remove them, and name a file with a token under token_file"
        )
    return parts


class _Response(http.client.HTTPResponse):
    """An answer of bounded length."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.fp: Any = Answer(self.fp)


class WebhookSender(Sender):
    """Posts each alert over a connection of its own."""

    def __init__(self, settings: WebhookHook, place: HookContext) -> None:
        self._settings, self._place = settings, place
        url = settings.url or settings.secret("url", place.base_dir) or ""
        try:
            self._parts = address_of(url)
        except ValueError as error:
            raise ConfigError(str(error)) from None
        self._token = settings.secret("token", place.base_dir)
        self._sign_key = settings.secret("sign_key", place.base_dir)
        hidden = (url if settings.url is None else None, self._token, self._sign_key)
        self.secrets = tuple(secret for secret in hidden if secret)
        self._tls = tls_context(settings.ca_file, place.base_dir)

    def send(self, alert: AnyAlert, more_changes: int) -> str:
        """Post the alert; the server must answer with a status of 200 to 299."""
        body = json.dumps(payload(alert, self._place.cell, more_changes)).encode()
        connection = self._connection()
        path = (self._parts.path or "/") + (f"?{self._parts.query}" if self._parts.query else "")
        try:
            with cut_after(self._settings.timeout_s, lambda: connection.sock):
                connection.request("POST", path, body, self._headers(body))
                response = connection.getresponse()
                status, asked = response.status, response.getheader("Retry-After")
        except (OSError, ValueError) as error:  # ValueError: TLS after the cut
            raise SendError(said(error)) from error
        except http.client.HTTPException as error:  # its text is what the server sent
            raise SendError("the peer is not an HTTP server") from error
        finally:
            connection.close()
        if 200 <= status < 300:
            return f"HTTP status {status}"
        if 300 <= status < 400:
            raise SendError(
                f"HTTP status {status}: redirects are not followed; put the final address into url",
                permanent=True,
            )
        again_s = retry_after_s(asked, time.time())
        later = "" if again_s is None else f" (requests a wait of {again_s:.0f} s)"
        raise SendError(
            f"HTTP status {status}{later}",
            permanent=status < 500 and status not in _LATER,
            again_s=again_s,
        )

    def _connection(self) -> http.client.HTTPConnection:
        host, port, timeout = self._parts.hostname or "", self._parts.port, self._settings.timeout_s
        connection = (
            http.client.HTTPConnection(host, port, timeout=timeout)
            if self._parts.scheme == "http"
            else http.client.HTTPSConnection(host, port, timeout=timeout, context=self._tls)
        )
        connection.response_class = _Response
        return connection

    def _headers(self, body: bytes) -> dict[str, str]:
        headers = {
            "Content-Type": "application/json",
            "User-Agent": "hri-predict",
            "Connection": "close",
        }
        if self._token is not None:
            headers["Authorization"] = f"Bearer {self._token}"
        if self._sign_key is not None:
            headers["X-Hri-Signature"] = signature(self._sign_key, body, int(time.time()))
        return headers


def retry_after_s(text: str | None, unix_s: float) -> float | None:
    """Seconds requested by ``Retry-After``, which is a number or a date (RFC 9110, 10.2.3)."""
    if text is None:
        return None
    if text.isascii() and text.strip().isdigit():
        return float(text.strip()[:9])
    try:
        at = parsedate_to_datetime(text)
        return max(0.0, at.timestamp() - unix_s)
    except (ValueError, OverflowError, OSError):  # no date either: it asks for nothing
        return None


def signature(key: str, body: bytes, unix_s: int) -> str:
    """``t=SECONDS,v1=HEX``: HMAC-SHA256 of the seconds, a dot and the body.

    Because the time is signed, the receiver can refuse a replayed message.
    """
    tag = hmac.new(key.encode(), f"{unix_s}.".encode() + body, hashlib.sha256)
    return f"t={unix_s},v1={tag.hexdigest()}"
