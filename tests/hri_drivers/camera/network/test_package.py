"""The npm package with BlazePose: fetched only when asked, checked, read."""

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
