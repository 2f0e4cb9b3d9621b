"""What ``import hri_predict`` offers, and what it costs."""

import ast
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import hri_predict

ROOT = Path(hri_predict.__file__).parents[1]
SOURCE = Path(hri_predict.__file__).read_text(encoding="utf-8")


def typed_names():
    """What the type checker is told: module -> names."""
    (block,) = [node for node in ast.parse(SOURCE).body if isinstance(node, ast.If)][:1]
    return {
        str(node.module).removeprefix("hri_predict."): {alias.name for alias in node.names}
        for node in block.body
        if isinstance(node, ast.ImportFrom)
    }


def test_the_type_checker_and_the_interpreter_know_the_same_names():
    loaded = {module: set(names.split()) for module, names in hri_predict._HOME.items()}
    assert typed_names() == loaded
    names = {name for group in loaded.values() for name in group}
    assert names | {"__version__"} == set(hri_predict.__all__)


@pytest.mark.parametrize("name", hri_predict.__all__)
def test_every_name_is_there(name):
    assert getattr(hri_predict, name) is not None
    assert name in dir(hri_predict)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'open_recordings'"):
        _ = hri_predict.open_recordings  # type: ignore[attr-defined]


def heavy_modules(code):
    """Which of torch and numpy are loaded after ``code`` in a fresh interpreter."""
    program = f"{code}\nimport sys\nprint(*[m for m in ('torch', 'numpy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_the_import_alone_loads_nothing_heavy():
    assert heavy_modules("import hri_predict") == []


def test_torch_is_loaded_for_trained_predictors_alone():
    everything = "import hri_predict\nfor n in hri_predict.__all__: getattr(hri_predict, n)"
    ask = "\nhri_predict.load_predictor('kalman')"
    assert heavy_modules(everything + ask) == ["numpy"]


def test_the_version_is_that_of_the_installed_package():
    """One source: the build reads it from ``hri_predict/__init__.py``."""
    pyproject = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert 'dynamic = ["version"]' in pyproject
    assert f'__version__ = "{hri_predict.__version__}"' in SOURCE
    said = subprocess.run(
        [sys.executable, "-m", "hri_predict", "--version"], capture_output=True, text=True
    )
    assert said.returncode == 0
    assert said.stdout == f"hri-predict {hri_predict.__version__}\n"
    assert metadata.version("hri-predict").split(".")[:1] == hri_predict.__version__.split(".")[:1]


def test_between_releases_the_version_is_the_next_one_with_dev():
    """As CONTRIBUTING asks: what is not a release must not look like one."""
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    heading, released = re.findall(r"^## (\S+)", changes, re.M)[:2]
    own = hri_predict.__version__
    if heading == "Unreleased":
        assert re.fullmatch(r"\d+\.\d+\.\d+\.dev0", own)
        assert [int(n) for n in own.split(".")[:3]] > [int(n) for n in released.split(".")]
    else:
        assert own == heading
