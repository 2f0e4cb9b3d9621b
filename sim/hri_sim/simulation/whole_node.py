"""Runs an episode through the whole node on the virtual clock: the result must be the same.

No earlier results are reused: the placed recording passes through people, predictor,
zones, publisher, link and controller, as in ``hri-predict run --speed max``.
"""

from collections.abc import Iterable

from hri_predict.run.session import Options, run
from hri_sim.simulation.cell import Cell, Variant, with_risk, with_scenario
from hri_sim.simulation.episode import Log
from hri_sim.simulation.scenario import Scenario

TOLERANCE_M = 0.01
"""Maximum difference of smallest separations: networks are equivariant except for rounding."""
TOLERANCE_S = 0.1
"""Maximum difference of the times of a stop: rounding may delay a threshold by one or two ticks."""


def disagreement(cell: Cell, scenario: Scenario, variant: Variant, log: Log) -> str:
    """Return the differences between the whole node's result and ``log``, or "".

    Contacts and stops must agree, stop times within ``TOLERANCE_S`` and the smallest separation
    within ``TOLERANCE_M``.
    """
    config = with_scenario(with_risk(cell.config, variant), scenario)
    summary = run(config, Options(factor=None))
    said = []
    for what, mine, whole in (
        ("contacts", log.contacts, summary.contacts),
        ("contacts while standing", log.contacts_standing, summary.contacts_standing),
    ):
        if mine != whole:
            said.append(f"{what} {mine}, whole node {whole}")
    stops = [_stops(report.events) for report in log.controllers]
    whole_stops = [_stops(report["events"]) for report in summary.controllers]
    if not all(_same(a, b) for a, b in zip(stops, whole_stops, strict=True)):
        said.append(f"stops {stops}, whole node {whole_stops}")
    mine_m, whole_m = log.min_separation_m, summary.min_separation_m
    if (mine_m is None) != (whole_m is None) or (
        mine_m is not None and whole_m is not None and abs(mine_m - whole_m) > TOLERANCE_M
    ):
        said.append(f"smallest separation {mine_m} m, whole node {whole_m} m")
    return "; ".join(said)


Stops = list[tuple[float, str]]
"""Time (s) and cause of each stop."""


def _stops(events: Iterable[tuple[float, str, float]]) -> Stops:
    return [(at_s, cause) for at_s, cause, limit in events if limit == 0.0]


def _same(mine: Stops, whole: Stops) -> bool:
    return len(mine) == len(whole) and all(
        cause == other and abs(at_s - whole_s) <= TOLERANCE_S
        for (at_s, cause), (whole_s, other) in zip(mine, whole, strict=True)
    )
