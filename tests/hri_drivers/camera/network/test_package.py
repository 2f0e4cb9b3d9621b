"""The npm package with BlazePose: fetched only when asked, checked, read."""

import gzip
import io
import json
import stat
import tarfile

import pytest

from hri_drivers.camera.network import package
from hri_predict.base.errors import ConfigError

LOADER = 'x(); loadPackage({"files": [%s], "remote_package_size": 9});'


def loader(*files):
    listed = [{"filename": name, "start": a, "end": b} for name, a, b in files]
    return LOADER % ", ".join(map(json.dumps, listed))


def tgz(**files):
    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w:gz") as archive:
        for name, content in files.items():
            info = tarfile.TarInfo("package/" + name.replace("__", "."))
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return data.getvalue()


WHOLE = {
    "pose_landmark_full__tflite": b"landmarks",
    "pose_solution_packed_assets__data": b"abcDETECTORxyz",
    "pose_solution_packed_assets_loader__js": loader(("/a/pose_detection.tflite", 3, 11)).encode(),
}


def test_the_networks_are_read_from_the_package(tmp_path):
    path = tmp_path / "pose.tgz"
    path.write_bytes(tgz(**WHOLE))
    detector, landmarks, digest = package.read(path, "full")
    assert (detector, landmarks) == (b"DETECTOR", b"landmarks")
    assert len(digest) == 64


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing", "no list"),
        (LOADER % "{}", "an unexpected form"),
        (loader(), "no pose_detection.tflite"),
        (loader(("pose_detection.tflite", 3, 99)), "exceeds"),
        (loader(("pose_detection.tflite", 5, 5)), "exceeds"),
        (loader(("pose_detection.tflite", None, 5)), "an unexpected form"),
        ('loadPackage({"files": 7});', "an unexpected form"),
        ("loadPackage({not json});", "Expecting property name"),
    ],
)
def test_an_archive_with_another_list_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        package.unpacked(b"0123456789", text, "pose_detection.tflite")


@pytest.mark.parametrize(
    "content",
    [b"", b"no archive", tgz(other__txt=b"x"), tgz(**WHOLE)[:60], tgz(**WHOLE)[:-30] + b"damaged"],
    ids=["empty", "text", "without it", "cut", "damaged"],  # the bytes hold the time
)
def test_a_damaged_package_is_one_line(content, tmp_path):
    path = tmp_path / "pose.tgz"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="--fetch-model") as caught:
        package.read(path, "full")
    assert "\n" not in str(caught.value)


def sparse(name, size):
    """A .tgz with a file of a few bytes that states this size: holes are zeros."""
    info = tarfile.TarInfo("package/" + name)
    info.type, info.size = tarfile.GNUTYPE_SPARSE, 512
    header = bytearray(info.tobuf(tarfile.GNU_FORMAT))
    header[386:398], header[398:410] = b"%011o\0" % 0, b"%011o\0" % 512
    header[483:495] = size.to_bytes(12, "big") if size >= 8**11 else b"%011o\0" % size
    header[483] |= 0x80 if size >= 8**11 else 0
    header[148:156] = b" " * 8
    header[148:156] = b"%06o\0 " % sum(header)
    return gzip.compress(bytes(header) + bytes(512 + 1024))


NET = "pose_landmark_full.tflite"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (gzip.compress(bytes(package.MAX_BYTES + 1), 1), "MiB once decompressed"),
        (sparse(NET, 2**40), "too large"),
        (tgz(**WHOLE, **{"other/pose_landmark_full__tflite": b"x"}), "twice"),
    ],
    ids=["expands", "states terabytes", "twice"],
)  # fmt: skip
def test_an_archive_that_would_fill_the_memory_is_one_line(content, message, tmp_path):
    path = tmp_path / "pose.tgz"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=message) as caught:
        package.read(path, "full")
    assert "\n" not in str(caught.value)


def test_only_the_files_that_are_needed_are_read(tmp_path):
    """A name that only begins alike is another file."""
    path = tmp_path / "pose.tgz"
    others = {"pose_solution_packed_assets__data2": b"x", NET.replace(".", "__") + "x": b"y"}
    path.write_bytes(tgz(**WHOLE, **others))
    names = [name.replace("__", ".") for name in WHOLE]
    assert sorted(package._members(path.read_bytes(), names)) == sorted(names)


def test_a_kept_package_that_changed_is_not_opened(tmp_path, monkeypatch):
    monkeypatch.setenv("HRI_PREDICT_DATA", str(tmp_path))
    package.kept_at().write_bytes(tgz(**WHOLE))
    monkeypatch.setattr(package, "_members", lambda *_: pytest.fail("opened"))
    with pytest.raises(ConfigError, match="replaced since it was fetched"):
        package.read(package.kept_at(), "full")


def test_a_missing_model_names_the_command(tmp_path, monkeypatch):
    monkeypatch.setenv("HRI_PREDICT_DATA", str(tmp_path))
    with pytest.raises(ConfigError, match="no model yet; fetch it with: hri-predict camera --f"):
        package.read(package.kept_at(), "full")


@pytest.fixture
def npm(tmp_path, monkeypatch):
    """An npm of the test's own, which is the only program to be found."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.setenv("HRI_PREDICT_DATA", str(tmp_path / "data"))

    def write(script: str):
        program = folder / "npm"
        program.write_text("#!/bin/sh\n" + script)
        program.chmod(program.stat().st_mode | stat.S_IXUSR)

    return write


DELIVER = 'printf %s "content" > "$5/' + package.FILE + '"\necho "$2" > "$5/../asked"\n'


def test_the_package_is_kept_if_it_is_the_one_that_was_tested(npm, monkeypatch):
    npm(DELIVER)
    digest = "ed7002b439e9ac845f22357d822bac1444730fbdb6016d3ec9432297b9ec9f73"  # of "content"
    monkeypatch.setattr(package, "SHA256", digest)
    path = package.fetch()
    assert path == package.kept_at()
    assert path.read_bytes() == b"content"


def test_another_package_is_refused_and_not_kept(npm):
    npm(DELIVER)
    with pytest.raises(ConfigError, match="is not the package that was tested"):
        package.fetch()
    assert not package.kept_at().exists()


@pytest.mark.parametrize(
    "script",
    ["echo 'npm ERR! code E404' >&2; exit 1", "exit 0", "echo 'npm error network' >&2; exit 1"],
)
def test_an_npm_that_fails_is_one_line(npm, script):
    npm(script)
    with pytest.raises(ConfigError, match=r"'npm pack @mediapipe/pose@[0-9.]*' failed") as caught:
        package.fetch()
    assert "\n" not in str(caught.value)


def test_without_npm_the_remedy_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConfigError, match="npm is not installed; install Node"):
        package.fetch()
