"""``simulate --occlude``: people lost by cameras, and the consequences in each risk mode."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict

from rich.console import Console
from rich.table import Table

from hri_predict.cli.common import progress
from hri_sim.simulation.request import OcclusionRequest, OcclusionRow


def occluded(request: OcclusionRequest, *, as_json: bool) -> int:
    """Play the episodes and print a table; 1 if a moving robot touched a person."""
    from hri_sim.simulation.occluded import simulate as play

    with progress() as bar:
        task = bar.add_task("episodes", total=request.episodes)
        rows = list(
            play(request, lambda done, total: bar.update(task, completed=done, total=total))
        )
    found = [_of_mode([row for row in rows if row.mode == mode]) for mode in request.modes]
    if as_json:
        print(
            json.dumps(
                {"request": asdict(request) | {"config": str(request.config)}, "modes": found}
            )
        )
    else:
        _show(request, found)
    for row in rows:
        if row.contacts:
            print(f"contact: episode {row.index}, mode {row.mode}", file=sys.stderr)
    return int(any(row.contacts for row in rows))


def _of_mode(rows: Sequence[OcclusionRow]) -> dict[str, object]:
    count = max(len(rows), 1)
    return {
        "mode": rows[0].mode if rows else "",
        "episodes": len(rows),
        "contacts": sum(row.contacts for row in rows),
        "contacts_standing": sum(row.contacts_standing for row in rows),
        "permitted": sum(row.permitted for row in rows) / count,
        "lost": sum(row.lost for row in rows) / count,
    }


def _show(request: OcclusionRequest, found: Sequence[dict[str, object]]) -> None:
    seen = "nothing is hidden" if not request.occlude else f"{request.cameras} camera(s)"
    free = ", free space seen" if request.free_space else ""
    rates = ", ".join(f"{rate:g}" for rate in request.rates_hz)
    table = Table(title=f"{request.episodes} episodes at {rates} Hz, {seen}{free}")
    for column in (
        "mode", "contacts, moving", "contacts, standing", "speed permitted, %", "person lost, %"
    ):  # fmt: skip
        table.add_column(column, justify="left" if column == "mode" else "right")
    for row in found:
        table.add_row(
            str(row["mode"]),
            str(row["contacts"]),
            str(row["contacts_standing"]),
            f"{100 * float(str(row['permitted'])):.1f}",
            f"{100 * float(str(row['lost'])):.1f}",
        )
    Console().print(table)
