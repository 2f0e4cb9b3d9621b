"""Code, data and libraries that must match for two machines to compute identical results."""

import hashlib
import platform
from collections.abc import Iterable
from functools import lru_cache
from importlib import metadata, util
from pathlib import Path

from hri_predict.base.files import data_path
from hri_predict.base.machine.compiled import is_compiled

_PACKAGES = ("hri_predict", "hri_drivers", "hri_sim")
_DECIDING = (".py", ".yaml", ".json", ".safetensors")
_LIBRARIES = ("hri-predict", "numpy", "torch", "onnxruntime", "numba")


@lru_cache(maxsize=1)
def code_digest() -> str:
    """Return the SHA-256 of the installed code, weights, calibrations and robots."""
    digest = hashlib.sha256()
    found = [util.find_spec(package) for package in _PACKAGES]
    folders = [
        Path(place) for spec in found if spec for place in spec.submodule_search_locations or ()
    ]
    for folder in (*folders, data_path()):
        for path in sorted(p for p in folder.rglob("*") if p.suffix in _DECIDING):
            digest.update(str(path.relative_to(folder)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


@lru_cache(maxsize=1)
def software() -> dict[str, str]:
    """Return the versions of Python, of the numerical libraries and of the project's own code."""
    versions = {"Python": platform.python_version()}
    for library in _LIBRARIES:
        try:
            versions[library] = metadata.version(library)
        except metadata.PackageNotFoundError:
            versions[library] = "none"
    versions["compiled loops"] = "yes" if is_compiled() else "no"
    return {**versions, "code": code_digest()[:12]}


def digests(paths: Iterable[Path]) -> dict[str, str]:
    """Path -> SHA-256 of the file, or "missing"."""
    return {str(path): _digest(path) for path in paths}


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return "missing"
