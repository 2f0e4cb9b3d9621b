"""Mistakes found after validation, when parts are built: each line names file, key and remedy."""

import pytest
import yaml

from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import HriPredictError
from hri_predict.run import assemble, config
from hri_predict.run.session import Options, run


def cell(**changes):
    return {
        "source": {"kind": "procedural", "people": [], "room_from_source": {}, "rate_hz": 30},
        "predictor": {"name": "constant_velocity"},
        "robots": [
            {
                "name": "arm",
                "model": "ur5e",
                "room_from_robot": {},
                "payload_kg": 1.0,
                "max_speed_m_s": 1.0,
                "motion": {"kind": "state"},
            }
        ],
        "risk": {"mode": "iso"},
        "links": [],
    } | changes


def recorded(**changes):
    return cell(source={"kind": "recording", "path": "monday.npz"} | changes)


def merged():
    sensor = {"kind": "recording", "path": "monday.npz"}
    return cell(source={"kind": "merged", "sensors": {"left": sensor, "right": sensor}})


def moving(**motion):
    data = cell()
    data["robots"][0]["motion"] = motion
    return data


def simulated(**simulate):
    simulate = {"role": "drive", "robot": "arm"} | simulate
    link = {"name": "drive", "kind": "serial", "port": "simulated", "baudrate": 921600}
    return cell(links=[link | {"simulate": simulate}])


def refused(path, data):
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    loaded = config.load(path)
    with pytest.raises(HriPredictError) as caught, loaded.naming_lines():
        run(loaded, Options(factor=None, duration_s=0.1))
    assert "\n" not in str(caught.value)
    place, key, said = str(caught.value).split(": ", 2)
    file, _, line = place.rpartition(":")
    assert file == str(path)
    last = key.split(".")[-1]
    assert last in path.read_text().splitlines()[int(line) - 1] or "missing" in said
    return key, said


@pytest.mark.parametrize(
    ("data", "key", "remedy"),
    [
        (
            moving(kind="state", plan="pick_and_plce"),
            "robots.0.motion.plan",
            "did you mean 'pick_and_place'?",
        ),
        (moving(kind="state", plan="path.yaml"), "robots.0.motion.plan", "check the path"),
        (moving(kind="trajectory", file="nowhere"), "robots.0.motion.file", "give the path"),
        (moving(kind="standing", positions=[0.0]), "robots.0.motion.positions", "give one for"),
        (simulated(), "links.drive.simulate.trajectory", "such as pick_and_place"),
        (simulated(trajectory="pick"), "links.drive.simulate.trajectory", "give the path"),
        (recorded(), "source.path", "check the path"),
        (recorded(joint_map="coco18"), "source.joint_map", "did you mean 'coco17'?"),
        (merged(), "source.sensors.left.path", "check the path"),
    ],
)
def test_a_late_mistake_names_the_file_and_the_key(tmp_path, data, key, remedy):
    found, said = refused(tmp_path / "cell.yaml", data)
    assert found == key
    assert remedy in said


def test_missing_weights_and_calibrations_name_their_keys(tmp_path):
    weights = cell(predictor={"name": "sinn", "weights": "own.safetensors"})
    key, said = refused(tmp_path / "cell.yaml", weights)
    assert key == "predictor.weights"
    assert "check the path" in said
    risk = {"mode": "predictive", "coverage": {"calibration": "own.json"}}
    key, said = refused(tmp_path / "cell.yaml", cell(risk=risk))
    assert key == "risk.coverage.calibration"
    assert "check the path" in said


def test_all_motions_that_do_not_fit_are_told_together(tmp_path):
    data = moving(kind="state", plan="nowhere")
    data["robots"].append(data["robots"][0] | {"name": "other"})
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    with pytest.raises(HriPredictError) as caught:
        assemble.build(config.load(path), VirtualClock(0))
    first, second = str(caught.value).splitlines()
    assert "robots.0.motion.plan" in first
    assert "robots.1.motion.plan" in second


def test_a_recording_of_the_command_line_is_no_mistake_of_the_configuration(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(recorded()))
    (tmp_path / "monday.npz").write_bytes(b"")
    played = config.load(path).with_source({"kind": "recording", "path": "tuesday.npz"})
    with pytest.raises(HriPredictError, match=r"^recording tuesday\.npz: no such file"):
        assemble.build_source(played)
