"""Passwords and keys, read from a file or an environment variable, never from the configuration.

The configuration's text goes into every recording.
"""

import logging
import os
import stat
from pathlib import Path

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import refuse_named_pipe

log = logging.getLogger(__name__)

MAX_BYTES = 4096


def read_secret(key: str, *, file: str | None, env: str | None, base_dir: Path) -> str | None:
    """Return the secret named by ``KEY_file`` or ``KEY_env``, without surrounding white space.

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
