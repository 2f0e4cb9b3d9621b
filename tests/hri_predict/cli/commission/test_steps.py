"""Steps of ``commission`` that change the configuration."""

import numpy as np
import pytest
import yaml

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.cli.commission import steps
from hri_predict.cli.commission.answers import Answers, RegistrationAnswers
from hri_predict.cli.register.sight import SightedPoint, Sights
from hri_predict.commissioning.typed_stops import MeasuredStop, typed_stops
from hri_predict.people.body.standing import standing_body
from hri_predict.run import config as configuration
from tests.hri_predict.commissioning.cells import cell_data, load_cell

POINTS = np.array([[0.5, -1.4, 1.0], [1.5, -1.4, 1.0], [1.5, -2.4, 1.2], [0.5, -2.4, 0.9]])
BODY = standing_body()
SIGHTS = Sights(positions=BODY[None], observed=np.ones((1, len(BODY)), bool), scenes=1)


@pytest.mark.parametrize(("wrong_m", "writes"), [(0.0, True), (0.3, False)])
def test_a_pose_that_does_not_fit_the_points_is_not_written(tmp_path, capsys, wrong_m, writes):
    data = cell_data(risk={"mode": "iso"})
    data["source"]["room_from_source"] = {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data, default_flow_style=None))
    before = path.read_text()
    seen = POINTS + np.array([0.1, 0.0, 0.0])
    seen[2, 1] += wrong_m  # one point was typed wrong

    def compare():
        return steps._compared(
            configuration.load(path),
            joint="r_hand",
            places=[SightedPoint(middle=point, spread_m=0.002, count=50) for point in seen],
            sights=[SIGHTS for _ in seen],
            points=POINTS,
            write=True,
        )

    if writes:
        found, _ = compare()
        assert max(point.error_m for point in found.points) < 1e-3
        (backup,) = set(tmp_path.iterdir()) - {path}
        assert backup.read_text() == before
        assert f"the old file is {backup.name}" in capsys.readouterr().err
    else:
        with pytest.raises(ConfigError, match="the points do not fit each other"):
            compare()
        assert path.read_text() == before
        assert list(tmp_path.iterdir()) == [path]


def test_the_sensors_of_a_merged_source_are_not_registered(tmp_path):
    data = yaml.safe_load(data_path("two_sensors.yaml").read_text(encoding="utf-8"))
    config = load_cell(tmp_path, data)
    with pytest.raises(ConfigError, match="a merged source cannot be registered"):
        steps.register_points(config, RegistrationAnswers(), simulated=False, interactive=False)


@pytest.mark.parametrize(("speed_m_s", "outcome"), [(0.1, "open"), (0.96, "passed")])
def test_the_nodes_own_stops_count_only_from_the_highest_speed(
    tmp_path, monkeypatch, speed_m_s, outcome
):
    config = load_cell(tmp_path)
    found = typed_stops(config, [MeasuredStop("arm", speed_m_s, 0.001, 0.001)])
    monkeypatch.setattr(steps.stopping, "measure_stops", lambda *_: (found, []))
    task = steps.Task(
        config=config, answers=Answers(), folder=tmp_path, simulate=True, interactive=False
    )
    step, _ = steps.do_step("stopping", task)
    assert step.outcome == outcome
    assert step.why == (
        [] if outcome == "passed" else ["robot arm: no stop from its highest speed, 1 m/s"]
    )
