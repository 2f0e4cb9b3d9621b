"""Suggestions for files that do not exist."""

import pytest

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.recording import open_recording
from hri_predict.run.config import find


@pytest.mark.parametrize(
    ("name", "suggested"),
    [("cel.yaml", "cell.yaml"), ("demmo.yaml", "demo.yaml"), ("missing.yaml", "")],
)
def test_a_configuration_is_sought_in_its_folder_first(tmp_path, name, suggested):
    (tmp_path / "cell.yaml").touch()
    with pytest.raises(ConfigError) as error:
        find(tmp_path / name)
    assert ("did you mean" in str(error.value)) == bool(suggested)
    assert f"{suggested}'?" in str(error.value) or not suggested
    assert len(str(error.value)) < 400


def test_a_recording_is_sought_in_its_folder(tmp_path):
    (tmp_path / "walking_1.npz").touch()
    with pytest.raises(RecordingError, match=r"walking_1\.npz"):
        open_recording(tmp_path / "walking.npz")
    with pytest.raises(RecordingError, match="no such file; check"):
        open_recording(tmp_path / "nowhere" / "walking.npz")
