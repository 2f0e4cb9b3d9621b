"""C3D files, against ezc3d, which we did not write; and what it cannot make: other machines."""

import struct
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.contracts.scene import Person, Scene
from hri_predict.recording import Recording, open_recording
from hri_predict.recording.converting import write_recording
from hri_predict.recording.formats.c3d_parameters import BLOCK, pack_parameters
from hri_predict.recording.naming import map_of_names
from tests.hri_predict.recording.made import of_scenes

LABELS = ["LWrist", "RWrist", "C7"]


def theirs(path: Path, labels, points, *, units="mm", rate=100.0, analog=0, **point) -> Path:
    """A file by ezc3d: points (3, N, F), NaN where missing."""
    ezc3d = pytest.importorskip("ezc3d", reason="the independent reader and writer")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [rate]
    file["parameters"]["POINT"]["UNITS"]["value"] = [units]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(labels)
    for name, value in point.items():
        file.add_parameter("POINT", name, value)
    file["data"]["points"] = np.concatenate([points, np.ones((1, *points.shape[1:]))])
    if analog:
        file["parameters"]["ANALOG"]["RATE"]["value"] = [rate * 10]
        file["parameters"]["ANALOG"]["LABELS"]["value"] = [f"a{k}" for k in range(analog)]
        file["data"]["analogs"] = np.zeros((1, analog, points.shape[2] * 10))
    file.write(str(path))
    return path


def ours(path: Path, positions, names, rate_hz=100.0) -> Path:
    """A file by us: positions (F, J, 3) metres, NaN where missing."""
    scenes = [
        Scene(round(k * 1e9 / rate_hz), k, True, (Person(1, row, np.isfinite(row[:, 0])),))
        for k, row in enumerate(positions)
    ]
    recording = of_scenes(scenes, map_of_names(names), rate_hz)
    write_recording(recording, path, "c3d", force=True)
    return path


def joints(recording: Recording) -> np.ndarray:
    """(F, P, J, 3)."""
    return np.array([[p.positions for p in scene.people] for scene in recording.scenes])


def points(frames=7, count=3, seed=0):
    found = np.random.default_rng(seed).uniform(-2000, 2000, (3, count, frames))
    found[:, 1, 2] = np.nan
    return found


def _error(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        open_recording(path, any_joints=True)
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("analog", [0, 3])
def test_we_read_what_ezc3d_writes(tmp_path, analog):
    raw = points()
    path = theirs(tmp_path / "a.c3d", LABELS, raw, analog=analog)
    recording = open_recording(path, any_joints=True)
    assert recording.rate_hz == 100.0
    assert recording.joint_map.source_joints == tuple(LABELS)
    expected = np.moveaxis(raw, 0, -1).swapaxes(0, 1)[:, None] / 1000
    np.testing.assert_allclose(joints(recording), expected, atol=2e-7)
    assert not recording.scenes[2].people[0].observed[1]


def test_ezc3d_reads_what_we_write(tmp_path):
    ezc3d = pytest.importorskip("ezc3d", reason="the independent reader and writer")
    positions = np.random.default_rng(1).uniform(-3, 3, (9, 300, 3))  # LABELS2 holds some
    positions[4, 7] = np.nan
    names = [f"marker {k}" for k in range(300)]
    file = ezc3d.c3d(str(ours(tmp_path / "a.c3d", positions, names, 59.94)))
    point = file["parameters"]["POINT"]
    assert point["LABELS"]["value"] + point["LABELS2"]["value"] == names
    assert point["UNITS"]["value"] == ["mm"]
    assert file["header"]["points"]["frame_rate"] == pytest.approx(59.94)
    read = np.moveaxis(file["data"]["points"][:3], 0, -1).swapaxes(0, 1)
    np.testing.assert_allclose(read, positions * 1000, rtol=1e-6)
    assert np.isnan(read[4, 7]).all()
    assert file["data"]["meta_points"]["residuals"][0, 7, 4] == -1


@pytest.mark.parametrize(("units", "metres"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
def test_units_are_those_of_the_file(tmp_path, units, metres):
    raw = points() / (1000 * metres)
    recording = open_recording(
        theirs(tmp_path / "a.c3d", LABELS, raw, units=units), any_joints=True
    )
    np.testing.assert_allclose(joints(recording)[0, 0, 0], raw[:, 0, 0] * metres, atol=1e-6)
    other = open_recording(tmp_path / "a.c3d", any_joints=True, unit_m=metres / 2)
    np.testing.assert_allclose(joints(other)[0, 0, 0], raw[:, 0, 0] * metres / 2, atol=1e-6)


def test_the_screens_vertical_is_up(tmp_path):
    up = np.zeros((3, 3, 2))
    up[1] = 1000.0  # along y
    y_up = theirs(tmp_path / "a.c3d", LABELS, up, X_SCREEN=["+X"], Y_SCREEN=["+Y"])
    np.testing.assert_allclose(joints(open_recording(y_up, any_joints=True))[0, 0, 0], [0, 0, 1])
    plain = theirs(tmp_path / "b.c3d", LABELS, up)
    np.testing.assert_allclose(joints(open_recording(plain, any_joints=True))[0, 0, 0], [0, 1, 0])
    turned = open_recording(plain, any_joints=True, axes=["z", "x", "y"])
    np.testing.assert_allclose(joints(turned)[0, 0, 0], [0, 0, 1])


def test_subjects_are_people_and_what_is_no_marker_is_left_out(tmp_path):
    labels = ["Anna:LWrist", "Ben:LWrist", "*12", "Anna:Angle", "Ben:C7"]
    path = theirs(tmp_path / "a.c3d", labels, points(count=5), ANGLES=["Anna:Angle"])
    recording = open_recording(path, any_joints=True)
    assert recording.joint_map.source_joints == ("LWrist", "C7")
    assert [p.id for p in recording.scenes[0].people] == [1, 2]
    anna, ben = recording.scenes[0].people
    assert (anna.observed.tolist(), ben.observed.tolist()) == ([True, False], [True, True])
    assert recording.note == (
        "2 of 5 labels are not markers of a person; 'Anna' is person 1; 'Ben' is person 2"
    )


@pytest.mark.long
def test_a_long_recording_has_more_frames_than_the_header_can_say(tmp_path):
    data = bytearray(ours(tmp_path / "a.c3d", np.zeros((3, 1, 3)), ["C7"]).read_bytes())
    at = data.index(b"ACTUAL_END_FIELD") + len("ACTUAL_END_FIELD") + 5
    assert struct.unpack_from("<HH", data, at) == (3, 0)
    struct.pack_into("<HH", data, at, 70_000 & 0xFFFF, 70_000 >> 16)
    long = np.zeros((70_000, 16), np.uint8).tobytes()  # of one point each
    (tmp_path / "a.c3d").write_bytes(bytes(data)[: -3 * 16] + long)
    recording = open_recording(tmp_path / "a.c3d", any_joints=True)
    assert len(recording.scenes) == 70_000
    assert "other counts" in recording.note  # the header's 3 is not a full one
    (tmp_path / "a.c3d").write_bytes((bytes(data)[: -3 * 16] + long)[:-7])
    assert "69999 of 70000 frames are there" in _error(tmp_path / "a.c3d")


def _altered(path: Path, **counts: int) -> Path:
    """Change what a file of ours states: header_first, header_last, header_start, header_points,
    or a parameter's first word."""
    data = bytearray(path.read_bytes())
    places = {"header_points": 2, "header_first": 6, "header_last": 8, "header_start": 16}
    for name, value in counts.items():
        at = places.get(name) or data.index(name.encode()) + len(name) + (
            5 if name.startswith("ACTUAL") else 4
        )
        struct.pack_into("<H", data, at, value)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    "stale",
    [
        {"header_last": 40},
        {"header_last": 200},
        {"header_first": 101, "header_last": 140},
        {"FRAMES": 40},
        {"FRAMES": 0, "header_last": 20},
        {"FRAMES": 65535, "header_last": 20},
        {"ACTUAL_END_FIELD": 200},
        {"ACTUAL_END_FIELD": 40, "FRAMES": 41, "header_last": 42},
        {"ACTUAL_END_FIELD": 240, "FRAMES": 241, "header_last": 242},
    ],
)
@pytest.mark.parametrize("padded", [False, True])
def test_of_several_counts_of_frames_the_data_decide(tmp_path, stale, padded):
    positions = np.random.default_rng(2).uniform(-1, 1, (60, 3, 3))
    path = _altered(ours(tmp_path / "a.c3d", positions, LABELS), **stale)
    if padded:
        data = path.read_bytes()
        path.write_bytes(data.ljust(-(-len(data) // BLOCK) * BLOCK, b"\0"))
    recording = open_recording(path, any_joints=True)
    np.testing.assert_allclose(joints(recording)[:60, 0], positions, atol=1e-6)  # 32-bit floats
    assert len(recording.scenes) == 60
    for count in stale.values():
        assert str(count) in recording.note or count in (0, 65535, 101, 140)


@pytest.mark.parametrize("zero", ["DATA_START", "header_start", "header_points"])
def test_a_zero_says_nothing_where_the_other_place_is_good(tmp_path, zero):
    positions = np.random.default_rng(2).uniform(-1, 1, (60, 3, 3))
    path = _altered(ours(tmp_path / "a.c3d", positions, LABELS), **{zero: 0})
    recording = open_recording(path, any_joints=True)
    np.testing.assert_allclose(joints(recording)[:, 0], positions, atol=1e-6)  # 32-bit floats


def test_a_rate_or_scale_of_zero_says_nothing_either(tmp_path):
    positions = np.random.default_rng(2).uniform(-1, 1, (6, 3, 3))
    path = ours(tmp_path / "a.c3d", positions, LABELS, 50.0)
    data = bytearray(path.read_bytes())
    for name in (b"RATE", b"SCALE"):
        at = data.index(name) + len(name) + 4
        struct.pack_into("<f", data, at, 0.0)
    path.write_bytes(data)
    recording = open_recording(path, any_joints=True)
    assert recording.rate_hz == 50.0
    np.testing.assert_allclose(joints(recording)[:, 0], positions, atol=1e-6)  # 32-bit floats


def test_points_at_exactly_zero_are_not_observed_and_counted(tmp_path):
    positions = np.random.default_rng(2).uniform(-1, 1, (6, 3, 3))
    positions[2:4, 1] = 0.0
    positions[5, 2] = [0.0, 0.0, 0.5]
    recording = open_recording(ours(tmp_path / "a.c3d", positions, LABELS), any_joints=True)
    seen = np.array([scene.people[0].observed for scene in recording.scenes])
    assert (~seen).sum() == 2
    assert not seen[2:4, 1].any()
    assert "2 points at exactly 0, 0, 0 are not observed" in recording.note


def as_integers(scale: float, xyz: np.ndarray, residuals: np.ndarray) -> bytes:
    """A file of 16-bit integers (F, N, 3), Intel."""
    frames, count = xyz.shape[:2]
    groups = {
        "POINT": {
            "USED": count,
            "FRAMES": frames,
            "SCALE": scale,
            "RATE": 50.0,
            "UNITS": "mm",
            "LABELS": LABELS[:count],
            "DATA_START": 3,
        }
    }
    packed = pack_parameters(groups)
    assert len(packed) == BLOCK
    head = struct.pack("<BBHHHHHfHHf", 2, 0x50, count, 0, 1, frames, 0, scale, 3, 0, 50.0)
    words = np.concatenate([xyz, residuals[..., None]], axis=-1).astype("<i2")
    return head.ljust(BLOCK, b"\0") + packed + words.tobytes()


def test_integers_are_scaled(tmp_path):
    xyz = np.random.default_rng(2).integers(-30000, 30000, (6, 2, 3))
    residuals = np.zeros((6, 2))
    residuals[3, 1] = -1
    (tmp_path / "a.c3d").write_bytes(as_integers(0.05, xyz, residuals))
    recording = open_recording(tmp_path / "a.c3d", any_joints=True)
    assert recording.rate_hz == 50.0
    expected = xyz * 0.05 / 1000
    expected[3, 1] = np.nan
    np.testing.assert_allclose(joints(recording)[:, 0], expected, atol=1e-7)
    ezc3d = pytest.importorskip("ezc3d", reason="the independent reader and writer")
    read = ezc3d.c3d(str(tmp_path / "a.c3d"))["data"]["points"][:3]
    np.testing.assert_allclose(np.moveaxis(read, 0, -1).swapaxes(0, 1) / 1000, expected, atol=1e-6)


@pytest.mark.parametrize("machine", [85, 86])
def test_files_of_dec_and_mips_machines(tmp_path, machine):
    """Made from ours by the definition of their numbers, value by value."""
    positions = np.random.default_rng(3).uniform(-2, 2, (4, 2, 3))
    positions[1, 1] = np.nan
    data = ours(tmp_path / "a.c3d", positions, ["LWrist", "C7"]).read_bytes()
    (tmp_path / "b.c3d").write_bytes(_of_machine(data, machine))
    expected = open_recording(tmp_path / "a.c3d", any_joints=True)
    found = open_recording(tmp_path / "b.c3d", any_joints=True)
    np.testing.assert_array_equal(joints(found), joints(expected))
    assert found.rate_hz == expected.rate_hz


def _of_machine(data: bytes, machine: int) -> bytes:
    big = machine == 86

    def word(raw: bytes) -> bytes:
        return raw[::-1] if big else raw

    def real(raw: bytes) -> bytes:
        if big:
            return raw[::-1]
        low, high = struct.unpack("<HH", struct.pack("<f", struct.unpack("<f", raw)[0] * 4))
        return struct.pack("<HH", high, low)  # VAX: the exponent's bias is 2 more, words swapped

    out = bytearray(data)
    start = (struct.unpack_from("<H", data, 16)[0] - 1) * BLOCK
    for k in range(2, 12, 2):
        out[k : k + 2] = word(data[k : k + 2])
    out[12:16], out[20:24] = real(data[12:16]), real(data[20:24])
    out[16:18] = word(data[16:18])
    out[BLOCK + 3] = machine
    at = BLOCK + 4
    while data[at]:
        length, group = struct.unpack_from("bb", data, at)
        here = at + 2 + length
        (offset,) = struct.unpack_from("<H", data, here)
        out[here : here + 2] = word(data[here : here + 2])
        kind, rank = struct.unpack_from("bB", data, here + 2)
        begin = here + 4 + rank
        if group > 0 and kind in (2, 4):
            for k in range(begin, here + offset - 1, kind):
                out[k : k + kind] = (word if kind == 2 else real)(data[k : k + kind])
        at = here + offset
    for k in range(start, len(data), 4):
        out[k : k + 4] = real(data[k : k + 4])
    return bytes(out)


def with_parameters(frames: int, points: int, **more: object) -> bytes:
    """A file whose header counts no more than 65535 frames; ``more`` goes into POINT."""
    packed = pack_parameters({"POINT": {"RATE": 100.0, "SCALE": -1.0, "UNITS": "m"} | more})
    start, last = 2 + len(packed) // BLOCK, min(frames, 65535)
    head = struct.pack("<BBHHHHHfHHf", 2, 0x50, points, 0, 1, last, 0, -1.0, start, 0, 100.0)
    return head.ljust(BLOCK, b"\0") + packed + bytes(16 * frames * points)


@pytest.mark.parametrize("name", ["LONG_FRAMES", pytest.param("FRAMES", marks=pytest.mark.long)])
def test_more_frames_than_the_header_can_count_are_all_read(tmp_path, name):
    """Counted as a float (c3d.org: POINT:FRAMES, POINT:LONG_FRAMES), without the TRIAL group."""
    path, more = tmp_path / "a.c3d", {"LABELS": ["C7"], name: 65537.0}
    path.write_bytes(with_parameters(65537, 1, **more))
    assert len(open_recording(path, any_joints=True).scenes) == 65537
    path.write_bytes(with_parameters(65537, 1, **more)[: -16 * 3 - 5])
    assert "65533 of 65537 frames" in _error(path)


@pytest.mark.parametrize("count", [float("nan"), float("inf"), float("-inf"), -5.0, 1e30])
def test_counts_that_are_not_numbers_count_nothing(tmp_path, count):
    path = tmp_path / "a.c3d"
    path.write_bytes(with_parameters(2, 1, LABELS=["C7"], FRAMES=count, LONG_FRAMES=count))
    assert len(open_recording(path, any_joints=True).scenes) == 2
    path.write_bytes(with_parameters(2, 0, LABELS=["C7"], USED=count))
    assert ": empty" in _error(path) or "truncated" in _error(path)


@pytest.mark.parametrize("start", [float("nan"), float("inf"), -1e30, 1e30, 0.5])
def test_points_that_start_nowhere_are_refused(tmp_path, start):
    path = tmp_path / "a.c3d"
    path.write_bytes(with_parameters(2, 1, LABELS=["C7"], DATA_START=start))
    assert "where the points start" in _error(path)


@pytest.mark.parametrize("name", ["UNITS", "LABELS", "Y_SCREEN"])
def test_a_text_without_dimensions_is_one_character(tmp_path, name):
    path = tmp_path / "a.c3d"
    data = bytearray(with_parameters(2, 1, **{"LABELS": ["C7"], "Y_SCREEN": "+Y", name: "mm"}))
    at = data.index(name.encode()) + len(name) + 3  # behind its name, offset and type
    data[at : at + 3] = b"\0m\0"
    path.write_bytes(data)
    recording = open_recording(path, any_joints=True)
    assert len(recording.scenes) == 2
    assert recording.joint_map.source_joints == ("m" if name == "LABELS" else "C7",)


def test_labels_end_with_the_section_of_parameters(tmp_path):
    """A last parameter without an end must not make texts of the whole file."""
    path = tmp_path / "a.c3d"
    data = bytearray(with_parameters(2, 1, LABELS=["C7"]) + bytes(2**21))
    at = data.index(b"LABELS") + len(b"LABELS")
    data[at : at + 8] = struct.pack("<HbBBBBB", 0, -1, 4, 1, 255, 255, 24)
    path.write_bytes(data)
    assert "a parameter goes past the end" in _error(path)


def test_cut_anywhere_it_is_an_error(tmp_path):
    path = ours(tmp_path / "a.c3d", np.zeros((3, 2, 3)), ["LWrist", "C7"])
    data = path.read_bytes()
    for keep in range(1, len(data), 37):
        path.write_bytes(data[:keep])
        assert "truncated" in _error(path) or "damaged" in _error(path)


def test_what_is_wrong_is_named(tmp_path):
    path = ours(tmp_path / "a.c3d", np.zeros((3, 2, 3)), ["LWrist", "C7"])
    good = path.read_bytes()
    for change, message in (
        ({BLOCK + 3: 99}, "processor type 99"),
        ({0: 200}, "where they start"),
        ({2: 0, good.index(b"USED") + 8: 0}, ": empty (0 points"),
        ({good.index(b"mm"): ord("q")}, "POINT:UNITS are 'qm'"),
    ):
        data = bytearray(good)
        for at, value in change.items():
            data[at] = value
        path.write_bytes(data)
        assert message in _error(path)
    path.write_bytes(b"HIERARCHY\n" * 200)
    assert "its content seems to be .bvh, BVH" in _error(path)


def test_names_that_the_format_cannot_hold_are_refused(tmp_path):
    for name in ("Handgelenk links \u00fc", "x" * 200):
        with pytest.raises(ConfigError, match="rename it"):
            ours(tmp_path / "a.c3d", np.zeros((2, 1, 3)), [name])
    assert list(tmp_path.iterdir()) == []
