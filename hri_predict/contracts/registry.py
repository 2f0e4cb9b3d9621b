"""Parts by name: sources, predictors, links, simulated cells, faults and commands.

A package adds, for example, a predictor through an entry point in the group
``hri_predict.predictors``. A part is imported only when requested by name, so a missing library
affects only parts that need it. The contracts define the parts: ``source``, ``predictor`` and
``link`` for those that any package may provide, ``cell`` for those of ``hri_sim``.
"""

import contextlib
import sys
import traceback
from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib import metadata
from typing import Any, Literal, overload

from hri_predict.base import installed
from hri_predict.base.errors import ConfigError, HriPredictError, failure, nearest
from hri_predict.base.work.identity import digest_of_package, joined
from hri_predict.contracts import cell
from hri_predict.contracts.link import AnyLinkClass, LinkSettings
from hri_predict.contracts.predictor import AnyPredictorClass, PredictorSettings
from hri_predict.contracts.source import AnySourceClass, SourceSettings

PartKind = Literal["sources", "predictors", "links"]
"""Parts that third parties may provide, checked by ``hri-predict conformance``."""
TrainingKind = Literal["data_sets", "optimisers", "schedules", "benchmarks"]
"""Parts of a training and its evaluation, besides those of ``lab``; see ``part``."""
Kind = PartKind | TrainingKind | Literal["commands", "predictor_settings", "cells", "faults"]

_SETTINGS = {"sources": SourceSettings, "predictors": PredictorSettings, "links": LinkSettings}


def _entry_points(kind: Kind) -> dict[str, metadata.EntryPoint]:
    return _registered(kind, tuple(sys.path))


@lru_cache
def _registered(kind: Kind, path: tuple[str, ...]) -> dict[str, metadata.EntryPoint]:
    return {e.name: e for e in _scanned(path) if e.group == f"hri_predict.{kind}"}


@lru_cache(maxsize=1)
def _scanned(_path: tuple[str, ...]) -> list[metadata.EntryPoint]:
    """Return the registrations of all packages on the path, which requires reading all of their
    metadata.
    """
    return installed.entry_points()


def names(kind: Kind) -> list[str]:
    """Names registered under ``kind``, sorted."""
    return sorted(_entry_points(kind))


def is_ours(kind: Kind, name: str) -> bool:
    """Whether ``name`` is provided by this package, not by a third party."""
    point = _entry_points(kind).get(name)
    dist = None if point is None else point.dist
    return dist is not None and installed.name_of(dist) == "hri-predict"


def code_of_part(kind: Kind, name: str) -> str | None:
    """Return the SHA-256 of the code of a third party's part; ``None`` if it is ours or unknown."""
    point = _entry_points(kind).get(name)
    return None if point is None or is_ours(kind, name) else digest_of_package(point.module)


def code_of(settings: PredictorSettings) -> str | None:
    """Return the hash of the third parties' code that a predictor runs; ``None`` if it runs none.

    The code of this package is left out: calibrations stay valid from one release to the next.
    """
    names = sorted({settings.name, *settings.runs()})
    codes = [code for name in names if (code := code_of_part("predictors", name)) is not None]
    return joined(codes) if codes else None


@overload
def load(kind: TrainingKind | Literal["commands"], name: str) -> Any: ...
@overload
def load(kind: Literal["sources"], name: str) -> AnySourceClass: ...
@overload
def load(kind: Literal["predictors"], name: str) -> AnyPredictorClass: ...
@overload
def load(kind: Literal["links"], name: str) -> AnyLinkClass: ...
@overload
def load(kind: Literal["cells"], name: str) -> cell.CellClass: ...
@overload
def load(kind: Literal["faults"], name: Literal["source"]) -> cell.SourceFaults: ...
@overload
def load(kind: Literal["faults"], name: Literal["link"]) -> cell.LinkFaults: ...
@overload
def load(kind: Literal["faults"], name: Literal["parse"]) -> cell.FaultParser: ...
def load(kind: Kind, name: str) -> Any:
    """Import and return the part registered as ``name``.

    Raises:
        ConfigError: the name is unknown (the message lists the known names), the part cannot be
            imported (the message names the missing extra or package), or it is not a class with a
            ``settings_model``.
    """
    points = _entry_points(kind)
    if name not in points:
        raise ConfigError(
            f"unknown {kind[:-1]} '{name}'{nearest(name, points)}; "
            f"available: {', '.join(sorted(points))}"
        )
    try:
        part = points[name].load()
    except ImportError as error:
        raise ConfigError(
            f"{kind[:-1]} '{name}' needs a package that is not installed: {error.name or error}; "
            f"{_remedy(points[name])}"
        ) from error
    except BaseException as error:
        failure(error)
        raise ConfigError(
            f"{kind[:-1]} '{name}' cannot be loaded: {_said(error)}; "
            f"fix the package that provides it"
        ) from error
    base = _SETTINGS.get(kind)
    model = getattr(part, "settings_model", None)
    if base is not None and not (
        isinstance(part, type) and isinstance(model, type) and issubclass(model, base)
    ):
        raise ConfigError(
            f"{kind[:-1]} '{name}' is not a class whose settings_model derives from "
            f"{base.__name__}; fix the package that provides it"
        )
    if kind == "predictors":
        _demand_own_name(name, part)
    return part


def _demand_own_name(name: str, part: Any) -> None:
    """Check that a trained predictor has the name of its entry point, which weights files state.

    Raises:
        ConfigError: it has another one, so it would refuse the weights that its training writes.
    """
    method = getattr(part, "method", None)
    if hasattr(part, "network_class") and isinstance(method, str) and method != name:
        raise ConfigError(
            f"predictor '{name}': its class {part.__name__} has method = '{method}', but its entry "
            f"point is '{name}'; give both the same name and install the package again"
        )


def part(kind: TrainingKind, name: str, ours: Mapping[str, Any]) -> Any:
    """Return the part of this name, from this or another installed package.

    Raises:
        ConfigError: the name is unknown, or the part cannot be imported.
    """
    if name in ours:
        return ours[name]
    known = sorted({*ours, *names(kind)})
    if name not in known:
        raise ConfigError(
            f"unknown {kind[:-1].replace('_', ' ')} '{name}'{nearest(name, known)}; available: "
            f"{', '.join(known)}"
        )
    return load(kind, name)


def predictor_settings(name: str) -> type[PredictorSettings]:
    """Return the settings model of a predictor, if possible without importing the predictor.

    The group ``hri_predict.predictor_settings`` lists the settings models of predictors whose
    modules import optional libraries, such as torch. If the group has no such name, the predictor
    itself is imported.

    Raises:
        ConfigError: see ``load``; or the registered object is not a ``PredictorSettings``.
    """
    point = _entry_points("predictor_settings").get(name)
    if point is None or name not in _entry_points("predictors"):
        return load("predictors", name).settings_model
    try:
        model = point.load()
    except BaseException as error:
        failure(error)
        raise ConfigError(
            f"settings of predictor '{name}' cannot be loaded: {_said(error)}; "
            f"fix the package that provides it"
        ) from error
    if not (isinstance(model, type) and issubclass(model, PredictorSettings)):
        raise ConfigError(
            f"predictor '{name}': its settings must be a subclass of PredictorSettings; fix the "
            "package that provides it"
        )
    return model


def building(what: str) -> contextlib.AbstractContextManager[None]:
    """Wrap the construction of a source, predictor or link, possibly from a third party.

    Raises:
        HriPredictError: the part's own error, or an error that names the failure.
    """
    return calling(f"{what} cannot be built", "correct it or its settings")


@contextlib.contextmanager
def calling(failed: str, remedy: str, package: str = "") -> Iterator[None]:
    """Wrap calls of code that may come from a third party.

    Raises:
        HriPredictError: the part's own error, or one line: ``failed``, the error, its place in
            ``package`` if given, and ``remedy``.
    """
    try:
        yield
    except HriPredictError:
        raise
    except BaseException as error:
        failure(error)
        where = _where(error, package) if package else ""
        raise ConfigError(f"{failed}: {_said(error)}{where}; {remedy}") from error


def _where(error: BaseException, package: str) -> str:
    """Return the innermost line of the package's code that an error passed through."""
    top = package.partition(".")[0]
    called = list(traceback.walk_tb(error.__traceback__))[2:]  # below ``calling`` and its user
    own = [
        (frame.f_code.co_filename, line)
        for frame, line in called
        if str(frame.f_globals.get("__name__")).partition(".")[0] == top
    ]
    return f" (in {own[-1][0]}:{own[-1][1]})" if own else ""


def _said(error: BaseException) -> str:
    """Return the type of an error and the first line of its text."""
    return f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}"


def _remedy(point: metadata.EntryPoint) -> str:
    """Return the extras to install, named in the entry point after its object: ``[fleet]``."""
    if not point.extras or point.dist is None:
        return "install it with pip"
    return (
        f"install it with: pip install '{installed.name_of(point.dist)}[{','.join(point.extras)}]'"
    )
