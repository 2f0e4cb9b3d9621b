"""The page of many cells. Run by ``fleet_feed``: ``python -m ...viewing.operator.fleet``."""

from typing import Any

from hri_predict.viewing.operator.server import serve
from hri_predict.viewing.operator.state import State

# -- data for the page of many cells ---------------------------------------------------------------


class FleetState(State):
    """The newest facts of all cells; see ``State``."""

    who = "hri-predict fleet"
    told_s = 0.1  # twice as often as pictures come, so that none waits

    def _always(self, facts: dict[str, Any], silent_s: float) -> dict[str, Any]:
        cells = facts.get("cells", [])
        return {"names": [cell["name"] for cell in cells], "silent_s": facts.get("silent_s", 0.0)}

    def _now(self, facts: dict[str, Any], since_s: float) -> dict[str, Any]:
        return {
            "cells": [_aged(cell, since_s) for cell in facts["cells"]],
            "trouble": facts["trouble"],
            "left_out": facts["left_out"],
        }


def _aged(cell: dict[str, Any], since_s: float) -> dict[str, Any]:
    """Return the cell with its current ages, to the millisecond."""
    ages = {name: cell[name] for name in ("heard_s", "age_s")}
    return cell | {n: None if age is None else round(age + since_s, 3) for n, age in ages.items()}


# --------------------------------------------------------------------------------------------------

if __name__ == "__main__":
    serve(FleetState(), "fleet")
