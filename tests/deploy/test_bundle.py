"""The bundle installs without a network, and only what it was made of."""

import base64
import hashlib
import importlib.util
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"


def bundling():
    spec = importlib.util.spec_from_file_location("bundle", DEPLOY / "bundle.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def wheel(folder, name, code, requires="", script=""):
    """A small but whole wheel (PEP 427)."""
    info = f"{name}-1.0.dist-info"
    needs = f"Requires-Dist: {requires}\n" if requires else ""
    files = {
        f"{name}.py": code,
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n{needs}",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/entry_points.txt": f"[console_scripts]\n{script}\n" if script else "",
    }
    record = ""
    for path, text in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=")
        record += f"{path},sha256={digest.decode()},{len(text.encode())}\n"
    path = folder / f"{name}-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as file:
        for inner, text in {**files, f"{info}/RECORD": f"{record}{info}/RECORD,,\n"}.items():
            file.writestr(inner, text)
    return path


@pytest.fixture
def bundle(tmp_path):
    """A bundle of two packages that stand for the project and all that it needs."""
    folder = tmp_path / "bundle"
    (folder / "wheels").mkdir(parents=True)
    main = "from needed import VALUE\ndef main():\n    print('hri-predict', VALUE)\n"
    wheel(folder / "wheels", "hri_predict", main, "needed", "hri-predict = hri_predict:main")
    wheel(folder / "wheels", "needed", "VALUE = 7\n")
    assert bundling().complete(folder) == 2
    return folder


def install(bundle, *arguments, **environ):
    return subprocess.run(
        [str(bundle / "install.sh"), *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        env={"PATH": "/usr/bin:/bin", "PYTHON": sys.executable, **environ},
    )


@pytest.mark.long
def test_a_bundle_installs_into_an_empty_environment_from_itself_alone(tmp_path, bundle):
    done = install(bundle, str(tmp_path / "opt"))
    assert (done.returncode, done.stdout.strip()) == (0, "hri-predict 7"), done.stderr


@pytest.mark.long
def test_a_wheel_that_was_exchanged_is_refused(tmp_path, bundle):
    wheel(bundle / "wheels", "needed", "VALUE = 8\n")
    done = install(bundle, str(tmp_path / "opt"))
    assert done.returncode != 0
    assert "HASH" in done.stderr.upper()


def test_another_python_is_one_line_with_the_remedy(tmp_path, bundle):
    (bundle / "python-version").write_text("3.99\n", encoding="utf-8")
    done = install(bundle, str(tmp_path / "opt"))
    assert done.returncode == 2
    assert done.stderr.startswith("error: the bundle is for Python 3.99")
    assert not (tmp_path / "opt").exists()
    assert install(bundle).returncode == 2  # no folder is named


def test_each_requirement_has_its_exact_version_and_hash(bundle):
    lines = (bundle / "requirements.txt").read_text(encoding="utf-8").splitlines()
    assert [line.split(" ")[0] for line in lines] == ["hri-predict==1.0", "needed==1.0"]
    digest = hashlib.sha256((bundle / "wheels" / "needed-1.0-py3-none-any.whl").read_bytes())
    assert lines[1].endswith(f"--hash=sha256:{digest.hexdigest()}")
