"""A file of the user's that is a pipe: it would be waited for, for ever."""

import os
import threading
from pathlib import Path

import pytest
import yaml

from hri_predict.base.errors import HriPredictError
from hri_predict.base.files import read_text, refuse_named_pipe
from hri_predict.cli.check.check import examine
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.operation.monitoring.alerts import AlertSettings, alert_file
from hri_predict.recording import Recorder, RecordingInfo
from hri_predict.run import config as configuration

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
SHIPPED = configuration.shipped("live_udp.yaml")


@pytest.fixture
def pipe(tmp_path):
    path = tmp_path / "pipe.yaml"
    os.mkfifo(path)
    return path


def refused(function, *arguments):
    """The error of something that must not wait: an open that does would hang the test."""
    errors: list[HriPredictError] = []

    def attempt():
        try:
            function(*arguments)
        except HriPredictError as error:
            errors.append(error)

    thread = threading.Thread(target=attempt, daemon=True)
    thread.start()
    thread.join(10)
    assert errors, "it waits for the pipe's other end"
    assert "is a pipe, not a file" in str(errors[0])
    assert "\n" not in str(errors[0])
    return str(errors[0])


def configured(tmp_path, **changes):
    data = yaml.safe_load(SHIPPED.read_text(encoding="utf-8"))
    for key, value in changes.items():
        data[key] = {**data[key], **value} if isinstance(data.get(key), dict) else value
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


def test_a_configuration_or_a_joint_map_that_is_a_pipe_is_refused(pipe):
    refused(configuration.load, pipe)
    refused(load_joint_map, str(pipe))


@pytest.mark.parametrize(
    "changes",
    [
        {"source": {"joint_map": "pipe.yaml"}},
        {"source": {"key_file": "pipe.yaml"}},
        {"alerts": {"file": "pipe.yaml"}},
        {
            "links": [
                {"name": "view", "kind": "zenoh", "cell": "press", "zenoh_config": "pipe.yaml"}
            ]
        },
    ],
)
def test_a_file_of_a_configuration_that_is_a_pipe_is_refused_by_check(pipe, tmp_path, changes):
    if "links" in changes:
        pytest.importorskip("zenoh")
    path = configured(tmp_path, **changes)
    assert "pipe.yaml" in refused(lambda: examine(configuration.load(path)))


def test_a_recording_is_not_written_into_a_pipe(pipe):
    info = RecordingInfo(
        joint_map=load_joint_map("canonical"),
        rate_hz=30.0,
        declares_noise=True,
        config="",
        predictor="constant_velocity",
        forecast_rate_hz=25.0,
    )
    assert "name another file" in refused(lambda: Recorder(pipe, info, threaded=False))


def test_what_a_shell_hands_over_is_read():
    read_end, write_end = os.pipe()
    os.write(write_end, b"rate_hz: 25\n")
    os.close(write_end)
    try:
        assert read_text(Path(f"/dev/fd/{read_end}"), "configuration") == "rate_hz: 25\n"
    finally:
        os.close(read_end)


def test_a_file_that_is_not_there_is_for_others_to_tell(tmp_path):
    refuse_named_pipe(tmp_path / "nothing")


@pytest.mark.parametrize("name", [".", "nowhere/alerts.jsonl"])
def test_an_alert_file_that_can_be_none_is_refused(tmp_path, name):
    with pytest.raises(HriPredictError, match=r"alerts.file .*; name another file"):
        alert_file(AlertSettings(file=name), tmp_path)
