"""Run the tests of a day or the long ones; JOBS tests run at a time, but those in real time.

``python -m tests.together daily JOBS`` (or ``long``). The daily tests in real time run before the
others: beside them they failed now and then, even where the others gave way. The long ones in real
time wait more than they compute, and run beside the others; ``beside`` runs the daily ones that
way. A file's tests stay with one worker, which makes their fixtures once. The long run also
checks every property with more examples (``EXAMPLES``, 100 if it is not set). Exit status 1 if a
test fails.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

_TESTS = [sys.executable, "-m", "pytest", "-m"]


def in_real_time() -> list[str]:
    """The files with tests in real time, whose text names the mark: no others need be imported."""
    files = Path(__file__).parent.rglob("test_*.py")
    return sorted(str(f) for f in files if "mark.realtime" in f.read_text(encoding="utf-8"))


def main(which: str, jobs: str) -> int:
    """Run all tests of ``which``."""
    spread = ["-n", jobs, "--dist", "loadfile"]
    if which == "long":
        others = [*_TESTS, "not realtime and (long or hypothesis)", *spread]
        return _beside(others, "realtime and long", {"EXAMPLES": "100", **os.environ})
    others = [*_TESTS, "not realtime and not long", *spread]
    if which == "beside":
        return _beside(others, "realtime and not long", dict(os.environ))
    alone = subprocess.run([*_TESTS, "realtime and not long", *in_real_time()], check=False)
    return int(subprocess.run(others, check=False).returncode != 0 or alone.returncode != 0)


def _beside(others: list[str], real_time: str, environment: dict[str, str]) -> int:
    """Run both kinds at a time; what those in real time print comes last."""
    with tempfile.TemporaryFile("w+") as printed:
        running = [
            subprocess.Popen(["nice", "-n", "19", *others], env=environment),
            subprocess.Popen(
                [*_TESTS, real_time, *in_real_time()],
                stdout=printed,
                stderr=printed,
            ),
        ]
        failed = [process.wait() != 0 for process in running]
        printed.seek(0)
        print(printed.read(), flush=True)
    return int(any(failed))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
