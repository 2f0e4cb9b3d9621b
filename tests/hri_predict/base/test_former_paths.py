"""Packages of others import the contracts by the paths of release 0.1, and are warned."""

import sys
from importlib import import_module

import pytest

from hri_predict.base.former_paths import FORMER
from tests.processes import python


@pytest.mark.parametrize(("former", "today"), FORMER.items())
def test_a_former_path_is_the_same_module(former, today):
    sys.modules.pop(former, None)
    with pytest.warns(DeprecationWarning, match=f"{former} is now {today}"):
        module = import_module(former)
    assert module is import_module(today)
    assert module.__spec__ is not None
    assert module.__spec__.name == today


def test_a_package_of_others_finds_names_by_former_paths():
    code = (
        "from hri_predict.predictors.base import Predictor\n"
        "from hri_predict.source import Source\n"
        "from hri_predict import contracts\n"
        "import hri_predict.link, hri_predict.contracts.predictor as new\n"
        "assert Predictor is new.Predictor\n"
    )
    done = python("-W", "always", "-c", code, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("DeprecationWarning") == 3


def test_an_unknown_path_is_still_unknown():
    with pytest.raises(ModuleNotFoundError):
        import_module("hri_predict.nothing")
