"""Run the tests of a day or the long ones, JOBS tests at a time.

``python -m tests.together daily JOBS`` (or ``long``). The daily tests in real time run before the
others, two at a time, since they wait more than they compute: beside the others 12 of 337 failed
and all took longer. The long ones in real time run one at a time, beside the others, which have the
lowest priority. A test in real time that fails for want of a processor fails if it fails again,
alone. A file's tests stay with one worker, which makes their fixtures once. The long run also
checks every property with more examples (``EXAMPLES``, 100 if it is not set). ``SHARE=1/3`` runs a
third of the tests, as their names fall: ``0/3``, ``1/3`` and ``2/3`` are all. The slow ones of
``tests.slow`` are long. Exit status 1 if a
test fails.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.slow import ROOT, slow_files

_TESTS = [sys.executable, "-m", "pytest", "-m"]
FAILED = 1
"""Status of pytest if tests failed; others mean that they could not be run."""
_FAILED = ["-o", "cache_dir=build/real-time"]
"""Where those in real time note what failed: the others have notes of their own."""
_PATIENT = ["--timeout", "600"]
"""Seconds for a long test that is not in real time, at the lowest priority."""


REAL_TIME = ("mark.realtime",)
LONG = ("mark.long", "hypothesis")


def names(file: Path, words: tuple[str, ...]) -> bool:
    """Whether a file of tests, or its folder's ``conftest.py``, has one of ``words``; or a slow
    test, if these are those of long tests."""
    if words == LONG and file.relative_to(ROOT).as_posix() in slow_files():
        return True
    texts = (f.read_text("utf-8") for f in (file, file.with_name("conftest.py")) if f.is_file())
    return any(word in text for text in texts for word in words)


def naming(words: tuple[str, ...]) -> list[str]:
    """Return the files of tests that name one of ``words``: no others need be imported."""
    files = sorted(Path(__file__).parent.rglob("test_*.py"))
    return [str(file) for file in files if names(file, words)]


def main(which: str, jobs: str) -> int:
    """Run all tests of ``which``."""
    spread = ["-n", jobs, "--dist", "loadfile"]
    if which == "long":
        marks = "not realtime and (long or hypothesis)"
        others = [*_TESTS, marks, *spread, *_PATIENT, *naming(LONG)]
        return _beside(others, {"EXAMPLES": "100", **os.environ})
    others = [*_TESTS, "not realtime and not long", *spread]
    chosen = [*_TESTS, "realtime and not long", *_FAILED, *naming(REAL_TIME)]
    two = ["-n", "2", "--dist", "loadfile"]
    alone = _again(chosen, subprocess.run([*chosen, *two], check=False).returncode)
    return int(subprocess.run(others, check=False).returncode != 0 or alone != 0)


def _beside(others: list[str], environment: dict[str, str]) -> int:
    """Run both kinds at a time; what those in real time print comes last."""
    chosen = [*_TESTS, "realtime and long", *_FAILED, *naming(REAL_TIME)]
    with tempfile.TemporaryFile("w+") as printed:
        beside = subprocess.Popen(chosen, stdout=printed, stderr=printed)
        failed = subprocess.run(["nice", "-n", "19", *others], env=environment, check=False)
        alone = beside.wait()
        printed.seek(0)
        print(printed.read(), flush=True)
    alone = _again(chosen, alone)
    return int(failed.returncode != 0 or alone != 0)


def _again(chosen: list[str], status: int) -> int:
    """Run those that failed once more, alone; the status."""
    if status != FAILED:
        return status
    return subprocess.run([*chosen, "--last-failed"], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
