"""Builds the C code for its tests, with all that a compiler can be made to complain about."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

C = Path(__file__).resolve().parents[3] / "drivers" / "c"
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow"]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]

Build = Callable[..., Path]


@pytest.fixture(
    scope="session", params=["plain", pytest.param("sanitized", marks=pytest.mark.long)]
)
def build(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Build:
    """Compile a program with the library; gives its path. Sanitizers are for the long run.

    Arguments: the program's source, further options, whether sanitizers do not disturb it.
    """
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler (cc) here")
    folder = tmp_path_factory.mktemp("c")
    built: dict[tuple[object, ...], Path] = {}

    def program(source: Path, *options: str, sanitize: bool = True) -> Path:
        sanitize = sanitize and request.param == "sanitized"
        key = (source, options, sanitize)
        if key not in built:
            built[key] = folder / f"{source.stem}-{len(built)}"
            debug = ["-g", "-O1", *SANITIZERS] if sanitize else ["-O2"]
            sources = [f"-I{C}", *map(str, [source, *sorted(C.glob("*.c"))])]
            command = [compiler, *WARNINGS, *debug, *options, "-o", str(built[key]), *sources]
            done = subprocess.run(command, capture_output=True, text=True)
            assert done.returncode == 0, done.stderr
        return built[key]

    return program
