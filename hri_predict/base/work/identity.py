"""Code, data and libraries that must match for two machines to compute identical results."""

import hashlib
import platform
from collections.abc import Iterable, Sequence
from functools import lru_cache
from importlib import metadata, util
from pathlib import Path

from hri_predict.base import installed
from hri_predict.base.files import data_path
from hri_predict.base.machine.compiled import is_compiled

_PACKAGES = ("hri_predict", "hri_drivers", "hri_sim")
_DECIDING = (".py", ".yaml", ".json", ".safetensors")
_HASHED = 16  # hexadecimal digits
_LIBRARIES = ("hri-predict", "numpy", "torch", "onnxruntime", "numba")


@lru_cache(maxsize=1)
def code_digest() -> str:
    """Return the SHA-256 of the installed code, weights, calibrations and robots."""
    return _digest_of_folders(_installed(), _DECIDING)


def is_installed(path: Path) -> bool:
    """Return whether ``code_digest`` covers a file."""
    inside = any(path.absolute().is_relative_to(folder.absolute()) for folder in _installed())
    return inside and path.suffix in _DECIDING


def _installed() -> list[Path]:
    found = [util.find_spec(package) for package in _PACKAGES]
    folders = [
        Path(place) for spec in found if spec for place in spec.submodule_search_locations or ()
    ]
    return [*folders, data_path()]


def digest_of_package(module: str) -> str:
    """Return the SHA-256 of the package of a module, or "missing"; nothing is imported.

    All of the package counts, because any of its modules may use any other.
    """
    try:
        spec = util.find_spec(module.partition(".")[0])
    except (ImportError, ValueError, AttributeError):
        spec = None
    if spec is None:
        return "missing"
    folders = [Path(place) for place in spec.submodule_search_locations or ()]
    if not folders:
        return _digest(Path(spec.origin or ""))
    return _digest_of_folders(folders, (*_DECIDING, ".so", ".pyd"))


def joined(hashes: Sequence[str]) -> str:
    """Return the first digits of a hash of these hashes, or of the only one."""
    whole = hashes[0] if len(hashes) == 1 else hashlib.sha256(" ".join(hashes).encode()).hexdigest()
    return whole[:_HASHED]


@lru_cache(maxsize=1)
def software() -> dict[str, str]:
    """Return the versions of Python, of the numerical libraries, of the project's own code and of
    the predictors of third parties.
    """
    versions = {"Python": platform.python_version()}
    for library in _LIBRARIES:
        try:
            versions[library] = metadata.version(library)
        except metadata.PackageNotFoundError:
            versions[library] = "none"
    versions["compiled loops"] = "yes" if is_compiled() else "no"
    for point in installed.entry_points():
        if point.group == "hri_predict.predictors" and not point.module.startswith("hri_predict."):
            code = digest_of_package(point.module)
            versions[f"code of predictor '{point.name}'"] = code[:12]
    return {**versions, "code": code_digest()[:12]}


def digests(paths: Iterable[Path]) -> dict[str, str]:
    """Path -> SHA-256 of the file, or "missing"."""
    return {str(path): _digest(path) for path in paths}


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return "missing"


def _digest_of_folders(folders: Iterable[Path], endings: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(p for p in folder.rglob("*") if p.suffix in endings):
            digest.update(str(path.relative_to(folder)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()
