"""The same episode through the whole node on the virtual clock: it must come out the same.

Nothing is played here: the placed recording goes through people, predictor, zones, publisher, link
and controller, as ``hri-predict run --speed max`` does.
"""

from hri_predict.session import Options, run
from hri_sim.simulation.cell import Cell, Variant, with_risk, with_scenario
from hri_sim.simulation.episode import Log
from hri_sim.simulation.scenario import Scenario

TOLERANCE_M = 0.01
"""Smallest separations may differ by this: a network is equivariant to rounding alone."""


def disagreement(cell: Cell, scenario: Scenario, variant: Variant, log: Log) -> str:
    """What the whole node finds otherwise than ``log``, or ""."""
    config = with_scenario(with_risk(cell.config, variant), scenario)
    summary = run(config, Options(factor=None))
    said = []
    for what, mine, whole in (
        ("contacts", log.contacts, summary.contacts),
        ("contacts while standing", log.contacts_standing, summary.contacts_standing),
        ("stops", [r.stops for r in log.controllers], [r["stops"] for r in summary.controllers]),
    ):
        if mine != whole:
            said.append(f"{what} {mine}, whole node {whole}")
    mine_m, whole_m = log.min_separation_m, summary.min_separation_m
    if (mine_m is None) != (whole_m is None) or (
        mine_m is not None and whole_m is not None and abs(mine_m - whole_m) > TOLERANCE_M
    ):
        said.append(f"smallest separation {mine_m} m, whole node {whole_m} m")
    return "; ".join(said)
