"""Run the tests of a day or the long ones; JOBS tests run at a time, but those in real time.

``python -m tests.together daily JOBS`` (or ``long``). The daily tests in real time run alone, after
the others: beside them they fail now and then, even where the others give way. The long ones in
real time wait more than they compute, and run beside the others. A file's tests stay with one
worker, which makes their fixtures once. The long run also checks every property with many random
examples (``EXAMPLES``, 100 if it is not set). Exit status 1 if a test fails.
"""

import os
import subprocess
import sys
import tempfile

_TESTS = [sys.executable, "-m", "pytest", "-m"]


def main(which: str, jobs: str) -> int:
    """Run all tests of ``which``."""
    spread = ["-n", jobs, "--dist", "loadfile"]
    return _daily(spread) if which == "daily" else _long(spread)


def _daily(spread: list[str]) -> int:
    others = subprocess.run([*_TESTS, "not realtime and not long", *spread], check=False)
    in_real_time = subprocess.run([*_TESTS, "realtime and not long"], check=False)
    return int(others.returncode != 0 or in_real_time.returncode != 0)


def _long(spread: list[str]) -> int:
    """Run both kinds at a time; what those in real time print comes last."""
    environment = {"EXAMPLES": "100", **os.environ}
    others = [*_TESTS, "not realtime and (long or hypothesis)", *spread]
    with tempfile.TemporaryFile("w+") as printed:
        running = [
            subprocess.Popen(["nice", "-n", "19", *others], env=environment),
            subprocess.Popen([*_TESTS, "realtime and long"], stdout=printed, stderr=printed),
        ]
        failed = [process.wait() != 0 for process in running]
        printed.seek(0)
        print(printed.read(), flush=True)
    return int(any(failed))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
