"""``calibrate`` warns of simulated people, where a recording tells that it has them."""

import pytest

from hri_predict.cli.calibrate.inputs import Data, warn_of_simulated
from hri_predict.recording import recording_info
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, run


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A second of the demo's simulated people."""
    path = tmp_path_factory.mktemp("recorded") / "night1.mcap"
    demo = configuration.load(configuration.shipped("demo.yaml"))
    run(demo.without_links(), Options(factor=None, duration_s=1.0, record=path))
    return path


def told(capsys, *paths):
    warn_of_simulated(Data(paths, None, None), "calibration")
    return capsys.readouterr().err


def test_recordings_of_simulated_people_are_named_in_one_line(recorded, tmp_path, capsys):
    assert told(capsys, recorded) == (
        f"warning: {recorded}: its people were simulated; zones calibrated on simulated motion "
        f"are not valid for real people\n"
    )
    other = tmp_path / "night2.mcap"
    other.write_bytes(recorded.read_bytes() + b" ")  # no copy: those are refused
    said = told(capsys, recorded, other)
    assert said.startswith(f"warning: {recorded} and 1 more: ")
    assert said.count("\n") == 1


def test_other_recordings_are_silent(recorded, tmp_path, capsys):
    live = tmp_path / "live.mcap"
    live.write_bytes(recorded.read_bytes().replace(b"kind: procedural", b"kind: udp       "))
    assert "kind: udp" in recording_info(live).config
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[:40])
    plain = tmp_path / "walk.npz"
    plain.write_bytes(b"")
    assert told(capsys, live, cut, plain) == ""
