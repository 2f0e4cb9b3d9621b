"""Run the tests of a day or the long ones: those in real time one after another, others beside.

``python -m tests.together daily JOBS`` (or ``long``): JOBS of the others run at a time, and give
way to those in real time, which wait more than they compute. A file's tests stay with one worker,
which makes their fixtures once. The long run also checks every property with many random examples
(``EXAMPLES``, 100 if it is not set). Exit status 1 if a test fails.
"""

import os
import subprocess
import sys
import tempfile

_TESTS = [sys.executable, "-m", "pytest", "-m"]
_CHOICES = {
    "daily": ("realtime and not long", "not realtime and not long"),
    "long": ("realtime and long", "not realtime and (long or hypothesis)"),
}


def main(which: str, jobs: str) -> int:
    """Run both; what those in real time print comes last."""
    in_real_time, others = _CHOICES[which]
    environment = dict(os.environ)
    if which == "long":
        environment.setdefault("EXAMPLES", "100")
    spread = ["-n", jobs, "--dist", "loadfile"]
    with tempfile.TemporaryFile("w+") as printed:
        running = [
            subprocess.Popen(["nice", "-n", "19", *_TESTS, others, *spread], env=environment),
            subprocess.Popen([*_TESTS, in_real_time], stdout=printed, stderr=printed),
        ]
        failed = [process.wait() != 0 for process in running]
        printed.seek(0)
        print(printed.read(), flush=True)
    return int(any(failed))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
