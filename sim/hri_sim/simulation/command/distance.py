"""``simulate --distance``: how near people may work while the robot runs."""

from hri_predict.cli.common import progress, show, tell
from hri_predict.lab.evaluation.table import Table
from hri_sim.simulation.request import DistanceRequest


def distances(request: DistanceRequest, *, as_json: bool) -> int:
    """Measure all cases and print a table."""
    from hri_sim.simulation.distance import run as measured

    with progress() as bar:
        task = bar.add_task("people", total=None)
        report = measured.run(
            request, lambda done, total: bar.update(task, completed=done, total=total)
        )
    if as_json:
        print(report.json)
    else:
        show([table for table in report.tables if isinstance(table, Table)], report.notes)
    if report.files:
        tell(report.files)
    return 0
