"""Commands are found by registration alone, and imported only when they are called."""

import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from hri_predict.cli.commands import ORDER
from tests.packages import third_party
from tests.processes import python

CALL = "import sys; from hri_predict.cli import main\n"
HEAVY = ("numpy", "pydantic", "torch", "hri_predict.node", "hri_predict.contracts", "hri_sim")
PARSER = ("typer", "rich", "importlib.metadata", "importlib.abc")


def command(*arguments: str, cwd: Path, **options) -> subprocess.CompletedProcess[str]:
    return python("-c", f"{CALL}main()", *arguments, cwd=cwd, timeout=120, **options)


def package(folder: Path, entry: str, source: str) -> None:
    """A package of others in ``folder`` that registers a command."""
    third_party(folder, f"[hri_predict.commands]\n{entry}\n", others=source)


def test_every_command_that_is_registered_has_its_place_in_the_list():
    points = metadata.entry_points(group="hri_predict.commands")
    ours = {p.name for p in points if p.dist is not None and p.dist.name == "hri-predict"}
    assert ours == set(ORDER)


@pytest.mark.parametrize(
    ("option", "unneeded"), [("--version", (*HEAVY, *PARSER)), ("--help", HEAVY)]
)
def test_help_and_version_import_nothing_heavy(option, unneeded, monkeypatch):
    monkeypatch.delenv("HRI_PREDICT_OWN_PROCESS", raising=False)  # as a user starts it
    code = (
        f"{CALL}sys.argv[1:] = ['{option}']\n"
        "try: main()\n"
        "except SystemExit as ended: assert not ended.code\n"
        f"print(*[name for name in {unneeded} if name in sys.modules], file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr.strip()) == (0, "")


@pytest.mark.long
def test_a_command_of_another_package_is_listed_and_runs(tmp_path):
    package(
        tmp_path,
        "greet = others:greet",
        'raise_at_import = 0\n\n\ndef greet(name: str = "all") -> None:\n'
        '    """Greet people by name."""\n    print(f"hello {name}")\n',
    )
    listed = command("--help", cwd=tmp_path)
    assert "greet" in listed.stdout
    assert "Greet people by name." in listed.stdout
    assert command("greet", "--name", "arm", cwd=tmp_path).stdout == "hello arm\n"


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("import nowhere_to_be_found", "needs a package that is not installed"),
        ("raise RuntimeError('broken')", "cannot be loaded: RuntimeError: broken"),
        ("def other(): ...", "cannot be loaded: AttributeError"),
        ("syntax error(", "cannot be loaded: SyntaxError"),
    ],
)
@pytest.mark.long
def test_a_command_that_cannot_be_loaded_is_one_line_and_harms_no_other(source, says, tmp_path):
    package(tmp_path, "greet = others:greet", source)
    done = command("greet", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("error: command 'greet' ")
    assert says in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert command("--help", cwd=tmp_path).returncode == 0


@pytest.mark.parametrize("entry", ["number = others:NUMBER", "odd = a b c", "nothing ="])
def test_what_is_not_a_function_is_no_command(tmp_path, entry):
    package(tmp_path, entry, "NUMBER = 3\n")
    name = entry.split()[0]
    assert command("--help", cwd=tmp_path).returncode == 0
    done = command(name, cwd=tmp_path)
    assert (done.returncode, "Traceback" in done.stderr) == (2, False)
    assert "fix the package" in done.stderr
