"""Import paths of release 0.1 that third-party packages may still use; removed after release
0.2.
"""

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType

FORMER = {
    "hri_predict.arrays": "hri_predict.base.arrays",
    "hri_predict.clock": "hri_predict.base.clock",
    "hri_predict.errors": "hri_predict.base.errors",
    "hri_predict.geometry": "hri_predict.base.geometry",
    "hri_predict.settings": "hri_predict.base.settings",
    "hri_predict.skeleton": "hri_predict.base.skeleton",
    "hri_predict.joint_map": "hri_predict.contracts.joint_map",
    "hri_predict.link": "hri_predict.contracts.link",
    "hri_predict.registry": "hri_predict.contracts.registry",
    "hri_predict.scene": "hri_predict.contracts.scene",
    "hri_predict.source": "hri_predict.contracts.source",
    "hri_predict.predictors.base": "hri_predict.contracts.predictor",
}
"""Former path -> current path of the module."""


class _Finder:
    """Finds a module under its former path; the import system tries it last.

    It derives from no class: ``importlib.abc`` imports much, and ``import hri_predict`` needs this.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in FORMER:
            return None
        return ModuleSpec(fullname, self)  # type: ignore[arg-type]  # it has a loader's methods

    def create_module(self, spec: ModuleSpec) -> None:
        """Let the import system create the module."""

    def exec_module(self, module: ModuleType) -> None:
        former = module.__name__
        warnings.warn(
            f"{former} is now {FORMER[former]}; the former path is removed after release 0.2",
            DeprecationWarning,
            stacklevel=2,
        )
        sys.modules[former] = import_module(FORMER[former])


def install() -> None:
    """Make former paths importable, with a ``DeprecationWarning``. A second call has no effect."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
