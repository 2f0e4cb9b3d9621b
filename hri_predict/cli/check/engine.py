"""``check``: what computes the networks, and how far it is from torch."""

from typing import Any

from hri_predict.predictors.base import Predictor


def engine_facts(predictor: Predictor) -> list[dict[str, Any]]:
    """Engine and difference of each network of a predictor; none for a baseline."""
    members = getattr(predictor, "members", [predictor])
    engines = [getattr(member, "engine", None) for member in members]
    return [
        {"name": engine.name, "differs_m": engine.differs_m}
        for engine in engines
        if engine is not None
    ]


def engine_lines(facts: list[dict[str, Any]]) -> list[str]:
    """A line for each."""
    return [
        f"network: computed by {engine['name']}"
        + (
            ""
            if engine["name"] == "torch"
            else f", within {1e3 * engine['differs_m']:.1g} mm of torch"
        )
        for engine in facts
    ]
