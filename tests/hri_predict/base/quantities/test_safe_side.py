"""Every number and switch says on which side it is less safe, or that it has no such side."""

import string
from typing import Any, ClassVar, get_args

import pytest
from pydantic import BaseModel, Field
from pydantic_core import PydanticUndefined

from hri_predict.base.quantities.safe_side import LessSafe, Safety, declared, harmless, less_safe
from hri_predict.base.settings import Region, Settings, models_in
from hri_predict.contracts import registry
from hri_predict.people.settings import PeopleSettings
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.settings import RobotSettings

SIMULATED = "hri_sim."  # what only exists in a simulation cannot hurt a person


def models() -> list[type[BaseModel]]:
    found: dict[type[BaseModel], None] = {}

    def add(model: type[BaseModel]) -> None:
        if model in found or model.__module__.startswith(SIMULATED):
            return
        found[model] = None
        for field in model.model_fields.values():
            for inner in models_in(field.annotation):
                add(inner)

    for model in (PeopleSettings, RiskSettings, RobotSettings, NamedZoneSettings):
        add(model)
    for kind in ("sources", "links"):
        for name in registry.names(kind):
            add(registry.load(kind, name).settings_model)
    return list(found)


def is_number(annotation: Any) -> bool:
    """Whether a type is a number or a switch, or may be none."""
    if annotation in (int, float, bool):
        return True
    return any(map(is_number, get_args(annotation))) and type(None) in get_args(annotation)


FIELDS = [
    pytest.param(model, key, id=f"{model.__name__}.{key}")
    for model in models()
    for key, field in model.model_fields.items()
    if is_number(field.annotation) and field.default is not PydanticUndefined
]


def test_there_are_many():
    assert len(FIELDS) > 80


@pytest.mark.parametrize(("model", "key"), FIELDS)
def test_each_number_and_switch_declares_its_less_safe_side(model, key):
    assert declared(model, key) is not None, (
        f"add '{key}' to {model.__name__}.safety: LessSafe(above=..., below=...), or harmless(...)"
    )


@pytest.mark.parametrize("model", models(), ids=lambda model: model.__name__)
def test_what_is_declared_exists_and_its_texts_can_be_written(model):
    for key, mark in model.__dict__.get("safety", {}).items():
        inherited = {
            name for each in models() if issubclass(each, model) for name in each.model_fields
        }
        assert key in inherited, f"{model.__name__} has no '{key}'"
        for text in (mark.above, mark.below, mark.other):
            names = {name for _, name, _, _ in string.Formatter().parse(text) if name}
            assert names <= {"value", "default", "more"}
            text.format(value=1.0, default=2.0, more=1.0)


class Inner(Settings):
    speed_m_s: float = 1.0

    safety: ClassVar[Safety] = {"speed_m_s": LessSafe(below="{more:g} m less in each second")}


class Outer(Settings):
    wait_s: float | None = None
    seen: bool = True
    port: int = 1
    exits: list[Region] = Field([])
    inner: Inner = Inner(speed_m_s=3.0)
    parts: dict[str, Inner] = Field({"arm": Inner(speed_m_s=2.0)})
    more: list[Inner] = Field([])

    safety: ClassVar[Safety] = harmless("port") | {
        "wait_s": LessSafe(above="waits {value:g} s"),
        "seen": LessSafe(other="nothing is seen"),
        "exits": LessSafe(other="a person who vanishes there is forgotten"),
    }


def found(computed: dict[str, float] | None = None, **values: Any) -> list[str]:
    return list(map(str, less_safe(Outer.model_validate(values), "x", computed or {})))


def test_the_defaults_are_not_less_safe():
    assert found() == []


def test_a_value_on_the_safe_side_is_not_named():
    assert found(inner={"speed_m_s": 4.0}, port=7) == []


def test_a_block_is_compared_with_the_default_of_its_key():
    assert found(inner={"speed_m_s": 2.0}) == [
        "x.inner.speed_m_s: 2 (default 3): 1 m less in each second"
    ]
    assert found(parts={"arm": {"speed_m_s": 1.5}}) == [
        "x.parts.arm.speed_m_s: 1.5 (default 2): 0.5 m less in each second"
    ]


def test_entries_of_a_list_are_compared_with_their_model():
    assert found(more=[{}, {"speed_m_s": 0.5}]) == [
        "x.more.1.speed_m_s: 0.5 (default 1): 0.5 m less in each second"
    ]


def test_a_computed_default_counts():
    assert found({"x.wait_s": 2.0}, wait_s=1.5) == []
    assert found({"x.wait_s": 2.0}, wait_s=2.5) == ["x.wait_s: 2.5 (default 2): waits 2.5 s"]


def test_switches_and_regions_are_named_with_their_size():
    door = {"polygon": [[0, 0], [24, 0], [24, 8.6], [0, 8.6]]}
    assert found(seen=False, exits=[door]) == [
        "x.seen: false (default true): nothing is seen",
        "x.exits: 24.0 x 8.6 m (default none): a person who vanishes there is forgotten",
    ]
