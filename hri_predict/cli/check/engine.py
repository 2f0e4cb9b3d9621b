"""``check``: what computes the networks and the risk stage, and how far it is from torch."""

from typing import Any

from hri_predict.base.machine.compiled import why_not_compiled
from hri_predict.contracts.predictor import Predictor


def engine_facts(predictor: Predictor) -> list[dict[str, Any]]:
    """Engine of each network of a predictor, and how far it is from torch; none for a baseline."""
    found = []
    for member in getattr(predictor, "members", [predictor]):
        engine = getattr(member, "engine", None)
        if hasattr(engine, "differs_m"):  # the user's own may mean another thing by it
            found.append({key: getattr(engine, key) for key in ("name", "differs_m", "why")})
    return found


def engine_lines(facts: list[dict[str, Any]]) -> list[str]:
    """A line for each."""
    return [
        f"network: computed by {engine['name']}"
        + (
            (f", because {engine['why']}" if engine["why"] else "")
            if engine["name"] == "torch"
            else f", within {1e3 * engine['differs_m']:.1g} mm of torch"
        )
        for engine in facts
    ]


def loops_line() -> str:
    """Whether the risk stage's loops are compiled, and if not, why."""
    why = why_not_compiled()
    if not why:
        return "risk stage: compiled loops"
    return f"risk stage: arrays, which take about three times as long, because {why}"
