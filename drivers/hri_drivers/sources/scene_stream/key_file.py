"""The file with the secret key: read once, checked, never shown."""

import hashlib
import hmac
import logging
import os
import shlex
import stat
from pathlib import Path

from hri_predict.base.errors import SourceError
from hri_predict.base.files import refuse_named_pipe

log = logging.getLogger(__name__)

MIN_BYTES, MAX_BYTES = 32, 1024
"""Limits of the key's length in bytes; RFC 2104 clause 3: a key shorter than the hash is weaker."""
TAG_BYTES = 16
"""Length of a tag; RFC 2104 clause 5: at least half of the hash, and at least 80 bits."""
_MAKE = '(umask 077; python -c "import secrets; print(secrets.token_hex(32))" > {})'


class Key:
    """A secret that is used only to compute tags; printing it shows only its file."""

    def __init__(self, secret: bytes, name: str) -> None:
        self._secret = secret
        self._name = name

    def __repr__(self) -> str:
        return f"Key({self._name!r})"

    def __reduce__(self) -> tuple[object, ...]:
        raise TypeError("a key cannot be copied into another process")

    def tag(self, data: bytes) -> bytes:
        """HMAC-SHA256 of ``data``, truncated to 16 bytes (RFC 2104)."""
        return hmac.digest(self._secret, data, hashlib.sha256)[:TAG_BYTES]

    def fits(self, data: bytes, tag: bytes) -> bool:
        """Whether ``tag`` is that of ``data`` with this key; takes constant time."""
        return hmac.compare_digest(self.tag(data), tag)


def read_key(path: str, base_dir: Path | None = None) -> Key:
    """Read a key: the file's bytes without white space at both ends.

    Args:
        path: path of the file; relative to ``base_dir``.
        base_dir: the configuration's folder.

    Raises:
        SourceError: the file cannot be read, or holds too few or too many bytes.
    """
    file = base_dir / path if base_dir is not None else Path(path)
    try:
        refuse_named_pipe(file)
        with file.open("rb") as stream:
            mode = os.fstat(stream.fileno()).st_mode
            secret = stream.read(MAX_BYTES + 1).strip()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = (error.strerror if isinstance(error, OSError) else None) or "no such path"
        raise SourceError(f"key_file {file}: cannot be read: {reason}; check the path") from None
    if not MIN_BYTES <= len(secret) <= MAX_BYTES:
        raise SourceError(
            f"key_file {file}: holds {len(secret)} bytes, expected {MIN_BYTES} to {MAX_BYTES}; "
            f"make one with: {_MAKE.format(shlex.quote(str(file)))}"
        )
    if os.name == "posix" and mode & (stat.S_IRWXG | stat.S_IRWXO):
        log.warning("key_file %s: other users can read it; run chmod 600 on it", file)
    return Key(secret, str(file))
