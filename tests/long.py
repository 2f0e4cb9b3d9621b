"""Run the tests marked ``long``: those in real time one after another, the others beside them.

``python -m tests.long JOBS``; the others run JOBS at a time, and give way to those in real time,
which wait more than they compute. Exit status 1 if a test fails.
"""

import subprocess
import sys
import tempfile

_TESTS = [sys.executable, "-m", "pytest", "-m"]


def main(jobs: str) -> int:
    """Run both; what those in real time print comes last."""
    side_by_side = ["-n", jobs, "--dist", "worksteal"]
    with tempfile.TemporaryFile("w+") as printed:
        alone = subprocess.Popen([*_TESTS, "long and realtime"], stdout=printed, stderr=printed)
        others = subprocess.Popen(
            ["nice", "-n", "19", *_TESTS, "long and not realtime", *side_by_side]
        )
        failed = [process.wait() != 0 for process in (others, alone)]
        printed.seek(0)
        print(printed.read(), flush=True)
    return int(any(failed))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
