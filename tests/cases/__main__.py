"""Every case of a folder of cases: ``python -m tests.cases ../shared/cases``.

From the checkout's root, with the developers' packages. Runs the tests that read these inputs, the
long ones too: files, cells, and scenarios with the whole node. Exit status 1 if one fails, 2 if the
folder is not one of cases.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

_READERS = (
    "tests/cases",
    "tests/hri_predict/recording/test_cases.py",
    "tests/hri_predict/recording/refusing/test_unseen.py",
    "tests/hri_predict/cli/check/test_cells_of_reports.py",
)


def main() -> int:
    """Run; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.cases", description=__doc__)
    parser.add_argument("folder", type=Path, help="with files, cells and scenarios")
    folder = parser.parse_args().folder.resolve()
    if not (folder / "files").is_dir() or not (folder / "cells").is_dir():
        print(f"error: {folder}: no folders 'files' and 'cells'", file=sys.stderr)
        return 2
    environment = os.environ | {"CASES": str(folder)}
    command = [sys.executable, "-m", "pytest", "-q", "-m", "long or not long", *_READERS]
    return int(subprocess.run(command, env=environment, check=False).returncode != 0)


if __name__ == "__main__":
    sys.exit(main())
