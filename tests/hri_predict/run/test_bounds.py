"""Every number of the configuration has a least and a greatest value that mean something."""

import math
from typing import Any, get_args

import pytest
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import models_in, validated
from hri_predict.contracts import registry
from hri_predict.robots.file import RobotFile, StoppingFile
from hri_predict.run import config
from hri_predict.run.config import NodeSettings

CELL = """\
rate_hz: 25
source:
  kind: procedural
  room_from_source: {xyz: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}
  people: [{start: [1.2, -0.2], script: [{do: wait, seconds: 20}]}]
predictor: {name: constant_velocity, horizon_s: 1.2}
robots:
  - name: arm
    model: ur5e
    room_from_robot: {xyz: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}
    max_speed_m_s: 1.0
risk: {mode: predictive}
links:
  - {name: plc, kind: can, interface: virtual, channel: a, reaction_s: 0.05}
"""
SIMULATED = "hri_sim."  # what only exists in a simulation cannot hurt anybody


def settings_models() -> list[type[BaseModel]]:
    found: dict[type[BaseModel], None] = {}

    def add(model: type[BaseModel]) -> None:
        if model in found or model.__module__.startswith(SIMULATED):
            return
        found[model] = None
        for field in model.model_fields.values():
            for inner in models_in(field.annotation):
                add(inner)

    for model in (NodeSettings, RobotFile):
        add(model)
    for kind in ("sources", "links"):
        for name in registry.names(kind):
            add(registry.load(kind, name).settings_model)
    for name in registry.names("predictors"):
        add(registry.predictor_settings(name))
    return list(found)


def numbers(annotation: Any, metadata: list[Any]) -> list[list[Any]]:
    """The constraints of every number in a type, at any depth."""
    if annotation in (float, int):
        return [metadata]
    inner = list(get_args(annotation))
    if inner and hasattr(annotation, "__metadata__"):
        own = [m for m in annotation.__metadata__ if not isinstance(m, FieldInfo)]
        for each in annotation.__metadata__:
            own += each.metadata if isinstance(each, FieldInfo) else []
        return numbers(inner[0], [*metadata, *own])
    is_union = type(None) in inner  # ``float | None``: the constraints are the number's
    return [c for part in inner for c in numbers(part, metadata if is_union else [])]


ALL = [
    pytest.param(model, key, id=f"{model.__name__}.{key}")
    for model in settings_models()
    for key, field in model.model_fields.items()
    if numbers(field.annotation, field.metadata)
]

# Checked by a validator that knows more than one field: names of the file that does it.
ELSEWHERE = {
    "quaternion_xyzw": "settings.py: a unit quaternion",
    "level": "risk/settings.py: one of three",
    "size": "risk/contact/fixtures.py",
    "position": "robots/file.py: of a joint, lower and upper",
    "positions": "robots/model.py: within the joints' limits",
    "speed_m_s": "robots/file.py (of a stopping table)",
    "time_s": "robots/file.py (of a stopping table)",
    "distance_m": "robots/file.py (of a stopping table)",
}


def test_there_are_many_numbers():
    assert len(ALL) > 100


@pytest.mark.parametrize(("model", "key"), ALL)
def test_no_number_may_be_absurdly_near_to_zero_or_without_end(model, key):
    field = model.model_fields[key]
    for constraints in numbers(field.annotation, field.metadata):
        if key in ELSEWHERE and not any(isinstance(c, Ge | Gt) for c in constraints):
            continue
        least: list[Any] = [c.ge for c in constraints if isinstance(c, Ge)]
        greatest: list[Any] = [c.le for c in constraints if isinstance(c, Le)]
        greatest += [c.lt for c in constraints if isinstance(c, Lt)]
        assert not [c for c in constraints if isinstance(c, Gt)], "say the least value with ge"
        assert least, "say the least value with ge"
        assert greatest, "say the greatest value with le"
        assert all(math.isfinite(bound) for bound in (*least, *greatest))


ABSURD = [
    ("max_speed_m_s: 1.0", "max_speed_m_s: 1e-12", "fastest point in production"),
    ("rate_hz: 25\n", "rate_hz: 1e-12\n", "cycles per second"),
    ("horizon_s: 1.2", "horizon_s: 1e-12", "horizon of the forecast"),
    ("reaction_s: 0.05", "silence_timeout_s: 1e-12", "silence after which"),
    ("mode: predictive", "mode: fixed, fixed_radius_m: 1e-12", "for mode fixed"),
    ("mode: predictive", "limits: {body_speed_m_s: 1e-12}", "everything else"),
    ("mode: predictive", "limits: {arm_acceleration_m_s2: 1e-9}", "of arms and hands"),
]


@pytest.mark.parametrize(("was", "absurd", "said"), ABSURD)
def test_an_absurd_number_is_one_line_with_its_place_and_the_bound(tmp_path, was, absurd, said):
    path = tmp_path / "cell.yaml"
    assert was in CELL
    path.write_text(CELL.replace(was, absurd, 1), encoding="utf-8")
    line = 1 + path.read_text(encoding="utf-8").splitlines().index(
        next(each for each in path.read_text(encoding="utf-8").splitlines() if "e-" in each)
    )
    with pytest.raises(ConfigError) as caught:
        config.load(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"{path}:{line}: ")
    assert "greater than or equal to" in text
    assert said in text


def stopping(**changed: Any) -> dict[str, Any]:
    row = {"payload_kg": 5.0, "time_s": [0.1, 0.2], "distance_m": [0.03, 0.1]} | changed
    return {"source": "test", "speed_m_s": [0.5, 1.0], "rows": [row]}


def test_a_stopping_table_of_a_robot_that_stops_at_once_is_refused():
    validated(StoppingFile, stopping(), "here")
    for absurd in (
        {"time_s": [1e-12, 1e-12], "distance_m": [1e-13, 1e-12]},
        {"distance_m": [1e-9, 1e-9]},
        {"time_s": [1e-3, 2e-3], "distance_m": [5e-4, 2e-3]},
    ):
        with pytest.raises(ConfigError, match="implausibly short stop"):
            validated(StoppingFile, stopping(**absurd), "here")
