"""The code that docs/library.md shows runs as it stands there, is short, and is well typed."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.recording.converting import write_recording
from hri_predict.recording.recording import recording_of_one
from hri_sim.people.body import Body

ROOT = Path(__file__).resolve().parents[1]
REAL = ROOT.parent / "shared" / "data" / "cmu_mocap" / "test" / "walking_1.npz"
TEXT = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
FORECAST, RING, ADVICE, MESSAGE = BLOCKS
WALK_M_S, RATE_HZ, SECONDS = 1.0, 30.0, 2.0


def write_walk(path):
    """Somebody who glides along x, standing upright: 2 s of canonical joints."""
    body = Body(1.75)
    pose = body.joints(body.standing(np.array([1.0, 0.5]), 0.0))
    times = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    motion = pose + WALK_M_S * times[:, None, None] * np.array([1.0, 0.0, 0.0])
    walk = recording_of_one(
        path=path.with_suffix(".none"),
        kind="csv",
        joint_map=load_joint_map("canonical"),
        raw=motion,
        rate_hz=RATE_HZ,
        person=1,
    )
    write_recording(walk, path, "amass")


@pytest.fixture(params=["written here", "real"])
def folder(request, tmp_path, monkeypatch):
    """A folder with the recording that the page names."""
    if request.param == "written here":
        write_walk(tmp_path / "walking_1.npz")
    elif REAL.exists():
        (tmp_path / "walking_1.npz").symlink_to(REAL)
    else:
        pytest.skip("needs ../shared/data for walking_1.npz")
    monkeypatch.chdir(tmp_path)
    return request.param


def run(block, capsys):
    """What a block prints, line by line, and its names."""
    names: dict[str, Any] = {}
    exec(block, names)
    return capsys.readouterr().out.splitlines(), names


@pytest.mark.parametrize("block", BLOCKS, ids=["forecast", "ring", "advice", "message"])
def test_each_is_at_most_ten_lines(block):
    assert block.startswith("import hri_predict")
    assert len([line for line in block.splitlines() if line.strip()]) <= 10


def test_the_forecast(folder, capsys):
    lines, names = run(FORECAST, capsys)
    recording, once = names["recording"], names["once"]
    assert len(lines) == len(recording.scenes) + 1
    for line in lines[:-1]:
        told = re.fullmatch(r"\d+\.\d\d s: people \(1,\), 1 s ahead ± (\d+\.\d\d) m", line)
        assert told is not None, line
        assert 0.01 < float(told[1]) < 2.0
    assert np.isfinite(once.positions).all()
    if folder == "written here":  # who keeps his velocity is where the forecast says, in 1 s
        first = recording.scenes[0].people[0].positions[once.joints.index("r_wrist")]
        # the file holds 32-bit floats: 2e-7 m at 3 m, ten times that over a span of 120 ms for 1 s
        expected = first + np.array([WALK_M_S * (once.capture_s[0] + 1.0), 0.0, 0.0])
        np.testing.assert_allclose(names["wrist"][-1], expected, atol=1e-5)


def test_the_ring_buffer(capsys):
    (line,), names = run(RING, capsys)
    window = names["window"]
    # the first joint moves at 1 m/s along x and is seen to the end: at 0.99 s it is held at the
    # newest sample before, for nothing later bridges to it
    assert line.startswith("[0.967 0.    1.5  ]") or line.startswith("[0.99  0.    1.5  ]")
    assert window.positions.shape == (25, 2, 3)
    seen = window.observed.sum(axis=0)
    assert 23 <= seen[0] <= 25
    assert 11 <= seen[1] <= 13  # the second was seen for the first half alone


def test_zones_and_advice(folder, capsys):
    lines, names = run(ADVICE, capsys)
    assert len(lines) == 10
    # unknown until enough captures confirm what may be released: the advisor has just begun
    known = {"CLEAR", "WARN", "SLOW", "STOP", "UNKNOWN"}
    assert {line.split()[0] for line in lines} <= known
    tick = names["tick"]
    assert len(tick.advices) == 1
    zones = tick.assessment.zones
    people, times, segments = zones.capsules.radius.shape
    assert (people, segments) == (1, 17)
    assert times == len(zones.times_s) > 25
    radius = zones.capsules.radius[0]
    assert (radius[-1] > radius[0]).all()  # one second ahead is less sure than now


def test_encode_and_decode(capsys):
    lines, names = run(MESSAGE, capsys)
    *classic, fd, line = lines
    assert [part.split()[0] for part in classic] == ["0x680", "0x681", "0x682"]
    assert fd.startswith("0x680 ")
    for said in (classic[-1], fd, line):
        assert "separation_m=0.8," in said
        assert "Level.SLOW" in said
    assert names["receiver"].counters.received == 1


@pytest.mark.long
def test_the_code_is_well_typed(tmp_path):
    api = pytest.importorskip("mypy.api")
    files = []
    for k, block in enumerate(BLOCKS):
        path = tmp_path / f"block_{k}.py"
        path.write_text(block, encoding="utf-8")
        files.append(str(path))
    wrong = tmp_path / "wrong.py"
    wrong.write_text("import hri_predict\nhri_predict.open_recordings(1)\n", encoding="utf-8")
    common = ["--config-file", str(ROOT / "pyproject.toml"), "--strict"]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        said, _, status = api.run([*common, *files])
        assert status == 0, said
        said, _, status = api.run([*common, str(wrong)])
    assert status == 1, "an unknown name must not pass as one of ours"
    assert 'Module has no attribute "open_recordings"' in said
