"""Sources, predictors, links and peers by name; third parties join by entry point.

A package adds, say, a predictor by an entry point in the group ``hri_predict.predictors``; nothing
is imported until its name is asked for, so a missing library never breaks what does not need it.
"""

from importlib import metadata
from typing import Any, Literal

from hri_predict.errors import ConfigError, nearest

Kind = Literal["sources", "predictors", "links", "cells", "faults", "simulations"]


def _entry_points(kind: Kind) -> dict[str, metadata.EntryPoint]:
    return {e.name: e for e in metadata.entry_points(group=f"hri_predict.{kind}")}


def names(kind: Kind) -> list[str]:
    """Names registered under ``kind``, sorted."""
    return sorted(_entry_points(kind))


def load(kind: Kind, name: str) -> Any:
    """Import and return the class registered as ``name``.

    Raises:
        ConfigError: nothing has this name (lists those there are), or it cannot be imported (names
            the extra or package that is missing).
    """
    points = _entry_points(kind)
    if name not in points:
        raise ConfigError(
            f"unknown {kind[:-1]} '{name}'{nearest(name, points)}; "
            f"there are: {', '.join(sorted(points))}"
        )
    try:
        return points[name].load()
    except ImportError as error:
        raise ConfigError(
            f"{kind[:-1]} '{name}' needs a package that is not installed: {error.name or error}; "
            f"{_remedy(points[name])}"
        ) from error
    except Exception as error:  # a third party's module may fail in any way
        raise ConfigError(
            f"{kind[:-1]} '{name}' cannot be loaded: {type(error).__name__}: {error}; "
            f"mend the package that brings it"
        ) from error


def _remedy(point: metadata.EntryPoint) -> str:
    """What to install: the extras that the entry point names after its object, ``[fleet]``."""
    if not point.extras or point.dist is None:
        return "install it with pip"
    return f"pip install '{point.dist.name}[{','.join(point.extras)}]'"
