"""Whether the daily tests notice: ``python -m tests.broken`` breaks one place in each room.

Each break is a line that a hand could slip on: a sign, a unit, a timeout, a comparison, a counter,
an order of levels, a width on the wire. It is made in a copy of the tree, where the tests of the
broken file run, and then, as long as none has failed, the daily tests of its room. Prints a line
for each break; exit status 1 if one is not found. Words after the command choose rooms.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
NOTHING_FAILED = 0
NOTICED = (1, 2)
"""Exit status of pytest where a test fails, or where its module cannot be imported any more."""
COPIED = ("hri_predict", "drivers", "sim", "configs", "tests", "docs", "deploy", "examples")


class Break(NamedTuple):
    """One break.

    Attributes:
        kind: what is broken, in a few words.
        file: in which file, from the root on.
        old: text that stands exactly once in it.
        new: text in its place.
        tests: tests that run first, from the root on.
    """

    kind: str
    file: str
    old: str
    new: str
    tests: str

    @property
    def room(self) -> str:
        """Return the folder below the package, as ``hri_predict/base``."""
        depth = 3 if self.file.startswith(("drivers/", "sim/")) else 2
        return "/".join(self.file.split("/")[:depth])

    @property
    def room_tests(self) -> str:
        """Return the folder with the tests of the room."""
        return "tests/" + re.sub("^(drivers|sim)/", "", self.room)


BREAKS = (
    Break(
        "sign: a capsule's radius is added to a distance",
        "hri_predict/base/geometry.py",
        "return axes - a.radius - b.radius",
        "return axes - a.radius + b.radius",
        "tests/hri_predict/base/test_geometry.py",
    ),
    Break(
        "width: a person's id has 8 bits on the wire",
        "hri_predict/protocol/definition.py",
        '_PERSON = Field(signal="PERSON", bits=16,',
        '_PERSON = Field(signal="PERSON", bits=8,',
        "tests/hri_predict/protocol/generate",
    ),
    Break(
        "square: beyond the table, a robot's stopping distance grows with its speed alone",
        "hri_predict/robots/stopping.py",
        "beyond = np.maximum(speeds / knots[-1], 1.0) ** 2",
        "beyond = np.maximum(speeds / knots[-1], 1.0)",
        "tests/hri_predict/robots/test_model.py",
    ),
    Break(
        "unit: an inch is ten times as long",
        "hri_predict/contracts/joint_map.py",
        '"inch": 0.0254',
        '"inch": 0.254',
        "tests/hri_predict/contracts/test_joint_map.py",
    ),
    Break(
        "sign: a hidden joint that was fast is nearer",
        "hri_predict/people/inferring.py",
        "since_s * (RECENT_M_S + before.speed_m_s)",
        "since_s * (RECENT_M_S - before.speed_m_s)",
        "tests/hri_predict/people/test_inferring.py",
    ),
    Break(
        "comparison: a clock that jumps back counts as a sample out of order",
        "hri_predict/people/ring_buffer.py",
        "if newest_ns - capture_ns > self._backward_limit_ns:",
        "if capture_ns - newest_ns > self._backward_limit_ns:",
        "tests/hri_predict/people/test_ring_buffer.py",
    ),
    Break(
        "off by one: a joint last seen some steps ago is put a step too far on",
        "hri_predict/predictors/baselines.py",
        "behind = (self.history_steps - 1 - newest)",
        "behind = (self.history_steps - newest)",
        "tests/hri_predict/predictors/test_baselines.py",
    ),
    Break(
        "order: the smaller of two deviations makes the zone",
        "hri_predict/zones/joint_zone_arrays.py",
        "return np.maximum(after, before)",
        "return np.minimum(after, before)",
        "tests/hri_predict/zones/test_joint_zones.py",
    ),
    Break(
        "order of levels: the milder of two demands counts",
        "hri_predict/risk/levels/demand.py",
        "worse = other if (other_rank, self.limit_m_s) > (rank, other.limit_m_s) else self",
        "worse = other if (other_rank, self.limit_m_s) < (rank, other.limit_m_s) else self",
        "tests/hri_predict/risk/levels/test_machine.py",
    ),
    Break(
        "timeout: a message kind is sent again after half a second",
        "hri_predict/node/shedding.py",
        "RESTORE_NS = 5_000_000_000",
        "RESTORE_NS = 500_000_000",
        "tests/hri_predict/node/test_shedding.py",
    ),
    Break(
        "unit: a part of a recording starts at milliseconds",
        "hri_predict/recording/cutting.py",
        "begin_ns = recording.arrival_ns[0] + round(start_s * 1e9)",
        "begin_ns = recording.arrival_ns[0] + round(start_s * 1e6)",
        "tests/hri_predict/cli/test_convert.py",
    ),
    Break(
        "counter: a change that was held back and is reported counts as one that was not",
        "hri_predict/operation/monitoring/flapping.py",
        "others = subject.held_back - (change is subject.held)",
        "others = subject.held_back",
        "tests/hri_predict/operation/monitoring/test_flapping.py",
    ),
    Break(
        "timeout: an episode goes on through twenty seconds without advice",
        "hri_predict/explaining/episodes.py",
        "GAP_NS = 2_000_000_000",
        "GAP_NS = 20_000_000_000",
        "tests/hri_predict/explaining/test_episodes.py",
    ),
    Break(
        "unit: a coverage of 90 % is reported as 0.9 %",
        "hri_predict/run/coverage.py",
        "{100 * coverage.level:g} %",
        "{coverage.level:g} %",
        "tests/hri_predict/run/test_coverage.py",
    ),
    Break(
        "unit: an error in millimetres is a tenth of what it is",
        "hri_predict/lab/evaluation/recordings.py",
        "1000.0 * total_m",
        "100.0 * total_m",
        "tests/hri_predict/lab/evaluation/test_recordings.py",
    ),
    Break(
        "comparison: a screen is sent levels that stay, and no change",
        "hri_predict/viewing/feed.py",
        "is not advice.level:",
        "is advice.level:",
        "tests/hri_predict/viewing/test_feed.py",
    ),
    Break(
        "factor: a standard deviation is the whole radius",
        "hri_predict/library/forecasting.py",
        "return radius / _DEVIATIONS",
        "return radius",
        "tests/hri_predict/library/test_spread.py",
    ),
    Break(
        "sign: a milder level than the validated one counts as stricter",
        "hri_predict/commissioning/compare.py",
        "milder = Level[was.level.upper()].rank - Level[row.level.upper()].rank",
        "milder = Level[row.level.upper()].rank - Level[was.level.upper()].rank",
        "tests/hri_predict/commissioning/test_compare.py",
    ),
    Break(
        "comparison: a link that is silent is not reported",
        "hri_predict/cli/listen.py",
        "if not silent and silence_s > SILENCE_S:",
        "if silent and silence_s > SILENCE_S:",
        "tests/hri_predict/cli/test_real_time.py",
    ),
    Break(
        "bound: a lost device is tried again every 2 s from the first time on",
        "drivers/hri_drivers/wires/backoff.py",
        "self._wait_s = min(2 * wait_s, LAST_S)",
        "self._wait_s = max(2 * wait_s, LAST_S)",
        "tests/hri_drivers/wires/test_backoff.py",
    ),
    Break(
        "sign: a body in a camera's picture is led back where it came from",
        "drivers/hri_drivers/camera/tracking.py",
        "return self.pixels + self.velocity *",
        "return self.pixels - self.velocity *",
        "tests/hri_drivers/camera/test_tracking.py",
    ),
    Break(
        "timeout: zones of captures that are five seconds old are sent",
        "drivers/hri_drivers/links/bulk.py",
        "STALE_NS = 500_000_000",
        "STALE_NS = 5_000_000_000",
        "tests/hri_drivers/links/test_supervised.py",
    ),
    Break(
        "off by one: in a flood a scene more than allowed is taken",
        "drivers/hri_drivers/sources/inbox.py",
        "return spare_ns // self._spacing_ns",
        "return spare_ns // self._spacing_ns + 1",
        "tests/hri_drivers/sources/test_inbox.py",
    ),
    Break(
        "order: a delayed frame overtakes the one before it",
        "sim/hri_sim/faults/link_faults.py",
        "due_ns = max(due_ns, way.late[-1][0])",
        "due_ns = min(due_ns, way.late[-1][0])",
        "tests/hri_sim/faults/test_injector.py",
    ),
    Break(
        "quantile: the 90th percentile is reported as the 99th",
        "sim/hri_sim/bench/rows.py",
        "np.percentile(seen, (50, 99))",
        "np.percentile(seen, (50, 90))",
        "tests/hri_sim/bench/test_rows.py",
    ),
    Break(
        "comparison: an arm brakes at once instead of by its deceleration",
        "sim/hri_sim/controllers/arm.py",
        "reached = max(wanted, speed - slower)",
        "reached = min(wanted, speed - slower)",
        "tests/hri_sim/controllers/test_arm.py",
    ),
    Break(
        "comparison: an incident in which nothing may move counts as a usable cell",
        "sim/hri_sim/fault_table/incident.py",
        "if incident.moving and not self.count(",
        "if incident.moving and self.count(",
        "tests/hri_sim/fault_table/test_incident.py",
    ),
    Break(
        "factor: noise that wanders grows smaller with its correlation time",
        "sim/hri_sim/people/tracker.py",
        "math.sqrt(1.0 - self._keeps**2) * fresh",
        "(1.0 - self._keeps) * fresh",
        "tests/hri_sim/people/test_tracker.py",
    ),
    Break(
        "order: a robot's registers hold the low byte first",
        "sim/hri_sim/robot_server/modbus.py",
        'f">{2 * JOINTS}f"',
        'f"<{2 * JOINTS}f"',
        "tests/hri_sim/robot_server/test_modbus.py",
    ),
    Break(
        "factor: an arm reports the speed of a slider at 1",
        "sim/hri_sim/rtde/arm.py",
        "math.cos(self._phase) * PHASE_RATE * self._rate",
        "math.cos(self._phase) * PHASE_RATE",
        "tests/hri_sim/rtde/test_arm.py",
    ),
    Break(
        "unit: QTM's microseconds are milliseconds",
        "sim/hri_sim/senders/mocap_ends.py",
        "self.time_s(scene) * 1e6",
        "self.time_s(scene) * 1e3",
        "tests/hri_sim/senders/test_mocap_ends.py",
    ),
    Break(
        "quantile: an interval of 95 % covers 90 %",
        "sim/hri_sim/simulation/results/statistics.py",
        "tail = (1 - LEVEL) / 2",
        "tail = 1 - LEVEL",
        "tests/hri_sim/simulation/results/test_statistics.py",
    ),
    Break(
        "counter: bytes that were taken from a wire may be taken again",
        "sim/hri_sim/wires/far_end.py",
        "credit -= taken",
        "credit -= 0",
        "tests/hri_sim/wires/test_far_end.py",
    ),
)


def copied(root: Path, folder: Path) -> Path:
    """Copy the tree's files, without what is built; data beside the tree stays in reach."""
    tree = folder / "tree"
    tree.mkdir()
    ignored = shutil.ignore_patterns("__pycache__", ".*", "build", "node_modules")
    for path in root.iterdir():
        if path.name in COPIED:
            shutil.copytree(path, tree / path.name, ignore=ignored)
        elif path.is_file():
            shutil.copy(path, tree)
    if (shared := root.parent / "shared").exists():
        (folder / "shared").symlink_to(shared)
    return tree


def fails(tree: Path, tests: str) -> bool:
    """Whether one of the daily tests fails.

    Raises:
        RuntimeError: no test was run.
    """
    ours = os.pathsep.join(map(str, (tree, tree / "drivers", tree / "sim")))
    paths = filter(None, (ours, os.environ.get("PYTHONPATH")))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # many starts in one tree
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--tb=no", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*command, "-m", "not long", tests],
        cwd=tree,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode == NOTHING_FAILED:
        return False
    if done.returncode in NOTICED or "while loading conftest" in done.stderr:
        return True
    raise RuntimeError(f"{tests}: pytest ended with {done.returncode}: {done.stdout[-2000:]}")


def found(tree: Path, broken: Break) -> bool:
    """Whether the tests notice a break of the tree; the tree is whole again afterwards."""
    path = tree / broken.file
    text = path.read_text(encoding="utf-8")
    if text.count(broken.old) != 1:
        raise RuntimeError(f"{broken.file}: must hold exactly once: {broken.old}")
    path.write_text(text.replace(broken.old, broken.new), encoding="utf-8")
    try:
        return fails(tree, broken.tests) or fails(tree, broken.room_tests)
    finally:
        path.write_text(text, encoding="utf-8")


def main(chosen: Iterable[str], root: Path = ROOT, breaks: Iterable[Break] = BREAKS) -> int:
    """Print what is found; return the exit status."""
    rooms, missed = set(chosen), 0
    with tempfile.TemporaryDirectory() as folder:
        tree = copied(root, Path(folder))
        for broken in breaks:
            if rooms and broken.room.split("/")[-1] not in rooms:
                continue
            seen = found(tree, broken)
            missed += not seen
            print(
                f"{'found' if seen else 'NOT FOUND':<10} {broken.room}: {broken.kind}", flush=True
            )
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
