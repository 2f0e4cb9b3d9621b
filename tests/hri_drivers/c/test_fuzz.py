"""The C code under mutated, truncated and random input, and what its protection lets pass.

The long runs, by hand: ``fuzz CORPUS 10000000`` and ``errors CORPUS 1000000 100000000`` (see
``drivers/c/README.md``).
"""

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

FUZZ = Path(__file__).resolve().parents[3] / "drivers" / "c" / "fuzz"
CORPUS = FUZZ / "corpus.txt"
PATTERNS = math.comb(64, 1) + math.comb(64, 2) + math.comb(64, 3)
FRESH = 5  # counters that are, of 256 or 65536
RANDOM = 300_000


def run(program: Path, *arguments: object) -> list[str]:
    command = [str(program), str(CORPUS), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def upper_bound(trials: int, probability: float) -> int:
    """The number of successes that is not exceeded with 99 %, of a Poisson distribution."""
    mean = trials * probability
    term = total = math.exp(-mean)
    k = 0
    while total < 0.99:
        k += 1
        term *= mean / k
        total += term
    return k


@pytest.fixture(scope="module")
def tried(build: Any) -> dict[str, tuple[int, int]]:
    """Name -> (tried, accepted)."""
    rows = run(build(FUZZ / "errors.c", sanitize=False), 2000, RANDOM)
    found = {}
    for row in rows:
        *name, _, count, accepted = row.split()
        found[" ".join(name)] = (int(count), int(accepted))
    return found


@pytest.mark.parametrize("seed", [1, 2])
def test_no_input_breaks_the_receiver(build: Any, seed: int) -> None:
    (row,) = run(build(FUZZ / "fuzz.c"), 150_000, seed)
    words = row.split()
    counts = dict(zip(words[::2], words[1::2], strict=True))
    assert counts["inputs"] == "150000"
    assert int(counts["accepted"]) > 1000  # it got behind the CRC
    assert int(counts["permitted"]) > 100  # and to where motion is permitted


def test_every_error_of_one_to_three_bits_in_a_classic_frame_is_refused(tried: Any) -> None:
    frames = sum(row.startswith("classic") for row in CORPUS.read_text().splitlines())
    assert frames == 5
    assert tried["classic"] == (frames * PATTERNS, 0)


@pytest.mark.parametrize("link", ["fd", "serial", "wire"])
def test_such_errors_in_longer_frames_are_refused(tried: Any, link: str) -> None:
    count, accepted = tried[link]
    assert count == 5 * 2000
    assert accepted == 0


@pytest.mark.parametrize(
    ("link", "probability"),
    [
        ("classic", 2.0**-8 * FRESH / 256),
        ("fd", 2.0**-16 * FRESH / 256),
        ("serial", 2.0**-32 * 2.0**-16 * 2.0**-32 * FRESH / 65536),  # CRC, length, data id, counter
    ],
)
def test_random_frames_are_accepted_no_more_often_than_the_profile_says(
    tried: Any, link: str, probability: float
) -> None:
    count, accepted = tried[f"random {link}"]
    assert count == RANDOM
    assert accepted <= upper_bound(count, probability)


def test_python_c_and_cantools_agree_on_random_messages(build: Any) -> None:
    here = Path(__file__)
    programs = [
        *("--decode", build(FUZZ.parent / "examples" / "decode.c")),
        *("--driver", build(here.with_name("driver.c"))),
    ]
    command = [sys.executable, here.with_name("agree.py"), *programs, "--messages", "1000"]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    agreed = json.loads(done.stdout)
    assert agreed["node to controller"]["fd"] == agreed["node to controller"]["serial"] == 1000
    assert agreed["node to controller"]["classic"] > 400  # it carries no Zone and no Pose
    assert agreed["controller to node"] == dict.fromkeys(("classic", "fd", "serial"), 100)


def test_the_socketcan_example_compiles(build: Any) -> None:
    if not Path("/usr/include/linux/can.h").exists():
        pytest.skip("no Linux CAN headers here")
    build(FUZZ.parent / "examples" / "socketcan.c", sanitize=False)
