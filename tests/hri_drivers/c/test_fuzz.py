"""The C code under mutated, truncated and random input, and what its protection lets pass.

The long runs, by hand: ``fuzz CORPUS 10000000`` and ``errors CORPUS 1000000 100000000`` (see
``drivers/c/README.md``).
"""

import json
import math
import shutil
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hri_predict.protocol.can import CanFrame, CanReceiver, CanSender
from hri_predict.protocol.definition import BY_TYPE
from hri_predict.protocol.generate.examples import EXAMPLES
from hri_predict.protocol.serial import SerialReceiver, SerialSender

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
    assert words[:2] == ["inputs", "150000"]
    assert int(words[3]) > 1000, "accepted: it got behind the CRC"
    assert int(words[5]) > 100, "permitted: it got to where motion is"
    before_kib, after_kib = int(words[-3]), int(words[-1])
    assert after_kib - before_kib < 2048


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


def spoiled(data: bytes, rng: np.random.Generator, longest: int) -> bytes:
    """As it is, or with wrong bits, cut off, or longer."""
    chance = rng.random()
    if chance < 0.5:
        return data
    if chance < 0.8:
        bits = int.from_bytes(data, "little")
        for bit in rng.integers(0, 8 * len(data), int(rng.integers(1, 4))):
            bits ^= 1 << int(bit)
        return bits.to_bytes(len(data), "little")
    if chance < 0.9:
        return data[: int(rng.integers(len(data)))]
    return (data + rng.bytes(int(rng.integers(1, 40))))[:longest]


@pytest.mark.parametrize("link", ["classic", "fd", "serial"])
def test_python_and_c_count_alike_what_is_wrong_with_a_stream(build: Any, link: str) -> None:
    """Lost, repeated, late and spoiled units: the same messages and counts from both."""
    rng = np.random.default_rng(7)
    sender: Any = SerialSender() if link == "serial" else CanSender(link == "fd")
    receiver: Any = SerialReceiver() if link == "serial" else CanReceiver(link == "fd")
    messages = [m for m in EXAMPLES if BY_TYPE[type(m)].sender == "node"]
    sent: list[Any] = []
    for _ in range(2500):
        message = messages[rng.integers(len(messages))]
        if link == "classic" and not BY_TYPE[type(message)].classic:
            continue
        units = sender.encode(message)
        sent += [units] if link == "serial" else units
    stream: list[Any] = []
    for k, unit in enumerate(sent):
        chance = rng.random()
        if chance < 0.1:
            continue
        unit = sent[max(0, k - int(rng.integers(9)))] if chance < 0.2 else unit
        data = unit if link == "serial" else unit.data
        data = spoiled(data, rng, 200 if link == "serial" else 64) if rng.random() < 0.3 else data
        stream.append(data if link == "serial" else replace(unit, data=data))
    lines, heard = [], []
    for unit in stream:
        heard.append([type(m).__name__ for m in receiver.feed(unit)])
        is_can = isinstance(unit, CanFrame)
        lines.append(f"{unit.arbitration_id:x} {unit.data.hex()}" if is_can else unit.hex())
    program = build(FUZZ.parent / "examples" / "decode.c")
    done = subprocess.run(
        [program, link, "1", "1"], input="\n".join(lines) + "\n", capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    *answers, counts = done.stdout.splitlines()
    assert len(answers) == len(heard)
    for answer, names in zip(answers, heard, strict=True):
        got = [] if answer == "-" else [part.split()[0] for part in answer.split("; ")]
        assert got == names
    want = asdict(receiver.counters)
    for word in counts.split()[1:]:
        name, _, value = word.partition("=")
        assert int(value) == want[name], name
    assert all(want[name] > 20 for name in ("received", "crc_errors", "counter_errors"))


@pytest.mark.long
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
    program = build(FUZZ.parent / "examples" / "socketcan.c", sanitize=False)
    done = subprocess.run([program, "no_bus"], capture_output=True, text=True, timeout=10)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("socketcan: no_bus cannot be opened: ")


def test_the_serial_example_tells_a_missing_argument_from_a_port_that_cannot_be_opened(
    build: Any, tmp_path: Path
) -> None:
    program = build(FUZZ.parent / "examples" / "serial.c")
    (tmp_path / "file").touch()
    for arguments, said in (
        ([], "usage: serial PORT"),
        ([tmp_path / "gone"], f"serial: {tmp_path}/gone cannot be opened: No such file"),
        ([tmp_path / "file"], f"serial: {tmp_path}/file cannot be opened: Inappropriate ioctl"),
    ):
        done = subprocess.run([program, *arguments], capture_output=True, text=True, timeout=10)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith(said)
        assert len(done.stderr.splitlines()) == 1


@pytest.mark.long
def test_the_commands_of_the_readme_compile(tmp_path: Path) -> None:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler (cc) here")
    lines = (FUZZ.parent / "README.md").read_text(encoding="utf-8").splitlines()
    commands = [line.replace("/tmp/", f"{tmp_path}/") for line in lines if line.startswith("cc ")]
    assert len(commands) == 5  # three examples, the fuzzer and the count of undetected errors
    for command in commands:
        done = subprocess.run(command, shell=True, cwd=FUZZ.parent, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
