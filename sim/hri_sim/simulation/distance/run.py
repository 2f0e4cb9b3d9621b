"""Runs all cases of the working distance, and creates a table, notes, JSON and plots."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import YAML_ENDINGS, atomic_write
from hri_predict.base.looks import can_plot
from hri_predict.base.skeleton import JOINTS
from hri_predict.base.work.workers_for import workers_for
from hri_predict.cli.check.remedies import remedy
from hri_predict.cli.common import warn, writing
from hri_predict.lab.evaluation.table import Table
from hri_predict.run import assemble
from hri_predict.run.compared_predictors import asked_predictors
from hri_predict.run.config import Config
from hri_predict.run.working_distance.measure import (
    FARTHEST_M,
    FAST,
    HELD,
    WARM_S,
    path_of,
    robot_of,
)
from hri_predict.run.working_distance.waterfall import TERMS, Waterfall, rest_text
from hri_sim.simulation.cell import FOREKNOWN, variants, with_risk
from hri_sim.simulation.distance.people import Activity, Sight, activities, pack, sights
from hri_sim.simulation.distance.work import (
    Case,
    DistancePlan,
    cell_of,
    joints_seen,
    measure,
    measure_terms,
)
from hri_sim.simulation.inputs import read_files, recorded
from hri_sim.simulation.request import DistanceRequest, SimulationReport

ACTIVITIES = ("window", "tools", "talking")
TRACKERS = ("full", "coco17", "legs-hidden", "waist-hidden", "marker_clusters9")
NOISES_M = (0.0, 0.02)
MODES = ("predictive", "iso", FOREKNOWN)
SECONDS = 8.0
REDUCED, LEAST_M = 3, 0.005
"""Number of terms with a remedy, and their minimum."""
Found = tuple[Case, dict[str, Any]]
"""A case and the results of ``measure`` by mode."""


Terms = tuple[Case, Waterfall]
"""A case in one mode, and its distance in terms."""


def run(request: DistanceRequest, progress: Callable[..., None]) -> SimulationReport:
    """Measure all cases.

    Args:
        request: the people, trackers, predictors and modes.
        progress: called with the number of cases done, of all, and the name of the last one.

    Raises:
        HriPredictError: the measurement cannot start; one line with the remedy.
    """
    people, notes = activities(request.activities or ACTIVITIES, pack(request.data))
    for note in notes:  # before minutes of measuring, and again under the table
        warn(note)
    plan = DistancePlan(
        config=str(request.config),
        robot=request.robot,
        seconds=request.seconds or SECONDS,
        error_m=request.error_m,
        drawn_noise_m=None if request.out is None else min(request.noises_m or NOISES_M),
    )
    cases = _cases(request, people, sights(request.trackers or trackers_of(cell_of(plan, None))))
    for name in dict.fromkeys(case.predictor for case in cases):
        config = cell_of(plan, name)
        variants(config, request.modes or MODES, ())
        index = robot_of(config, request.robot)
        path_of(config, assemble.build_robots(config)[index], index)
    split = _split(cases[0])
    tasks: list[Any] = [] if split is None else [(measure_terms, plan, split)]
    ahead = len(tasks)
    tasks += [(measure, plan, case) for case in cases]
    done: dict[int, Any] = {}
    progress(0, len(tasks))
    with workers_for(request.jobs, request.cluster, _reads(plan, cases)) as workers:
        for place, result in workers.each(_call, tasks):
            done[place] = result
            name = "the largest terms" if place < ahead else _name(cases[place - ahead])
            progress(len(done), len(tasks), name)
    found = [(case, done[place]) for place, case in enumerate(cases, start=ahead)]
    terms = None if split is None else (split, done[0])
    return _report(request, plan, found=found, terms=terms, notes=notes)


def trackers_of(cell: Config) -> Sequence[str]:
    """Return the cell's own tracker, also behind benches; several if it delivers any joint."""
    own = getattr(cell.source, "joint_map", None)
    if own in (None, "canonical"):
        return TRACKERS
    if own.endswith(YAML_ENDINGS):
        own = str((cell.base_dir or Path()) / own)
    return (own, *(f"{own}+{hidden}" for hidden in ("legs-hidden", "waist-hidden")))


def _split(case: Case) -> Case | None:
    """Return the case with the mode whose distance is split into terms; ``None`` without one.

    The true future replaces the zones, so its distance does not consist of the terms.
    """
    modes = tuple(mode for mode in case.modes if mode != FOREKNOWN)
    return replace(case, modes=modes[:1]) if modes else None


def _reads(plan: DistancePlan, cases: Sequence[Case]) -> list[Path]:
    """Return the files that determine the distances, except for those of the installation."""
    configs = [cell_of(plan, name) for name in dict.fromkeys(case.predictor for case in cases)]
    trackers = dict.fromkeys(case.sight.tracker for case in cases)
    maps = [Path(name) for name in trackers if name and name.endswith(YAML_ENDINGS)]
    return read_files(configs, [*recorded(case.activity.motion for case in cases), *maps])


def _name(case: Case) -> str:
    noise = f", noise {100 * case.noise_m:g} cm" if case.noise_m else ""
    return ", ".join(filter(None, (case.activity.text, case.sight.name + noise, case.predictor)))


def _call(function: Callable[[DistancePlan, Case], Any], plan: DistancePlan, case: Case) -> Any:
    return function(plan, case)


def _cases(
    request: DistanceRequest, people: Sequence[Activity], seen: Sequence[Sight]
) -> list[Case]:
    """Return all cases: each person once with the same joints, and once with the true future.

    Raises:
        ConfigError: no tracker delivers a joint of these people.
    """
    modes, cases = request.modes or MODES, []
    noises_m = request.noises_m or NOISES_M
    asked_predictors(request.predictors)
    for predictor, activity in product(request.predictors or (None,), people):
        known: set[tuple[float, tuple[float, ...]]] = set()
        own = modes
        for sight, noise_m in product(seen, noises_m):
            case = Case(
                activity=activity, sight=sight, noise_m=noise_m, predictor=predictor, modes=own
            )
            joints = joints_seen(case)
            if not any(joints) or (noise_m, joints) in known:
                continue
            known.add((noise_m, joints))
            cases.append(case)
            own = tuple(mode for mode in modes if mode != FOREKNOWN)
    if not cases:
        raise ConfigError("--tracker: delivers no joint of these people; name another")
    return [case for case in cases if case.modes]


def _report(
    request: DistanceRequest,
    plan: DistancePlan,
    *,
    found: Sequence[Found],
    terms: Terms | None,
    notes: Sequence[str],
) -> SimulationReport:
    config = cell_of(plan, None)
    robot = config.node.robots[robot_of(config, plan.robot)]
    said = [
        f"Distance, m, from the base of robot {robot.name} to the person's mean place at which it "
        f"may run at {FAST * robot.max_speed_m_s:.2g} m/s or more for {HELD:.0%} of the time, from "
        f"{WARM_S:g} to {plan.seconds:g} s; each person is only moved and turned over the floor.",
        "A tracker is left out if a recording has no more of its joints than of a tracker above.",
        *notes,
    ]
    if plan.error_m:
        said.append(f"The tracker states an error of each person's place of {plan.error_m:g} m.")
    tables = [_table(found, request.modes or MODES, config.predictor.name)]
    tables += _sets_table(found)
    if terms is not None and terms[1].total_m is not None:
        tables.append(_terms_table(*terms))
        said += remedies_of(*terms, cell_of(plan, terms[0].predictor))
    data = {
        "configuration": Path(plan.config).name,
        "robot": robot.name,
        "seconds": plan.seconds,
        "error_m": plan.error_m,
        "cases": [_plain(case, result, config.predictor.name) for case, result in found],
        "waterfall": None if terms is None else _plain_terms(*terms),
        "notes": said,
    }
    text = json.dumps(data, indent=1)
    files = [] if request.out is None else _written(request.out, tables, said, text)
    if request.out is not None and can_plot():
        from hri_sim.simulation.distance.plot import write_plots

        files += write_plots(found, terms, request.out)
    return SimulationReport(tables=tables, notes=said, json=text, files=files, disagreements=[])


def _table(found: Sequence[Found], modes: Sequence[str], own: str) -> Table:
    several = len({case.predictor for case, _ in found}) > 1
    first = ("person", "seen", "noise, cm", *(("predictor",) if several else ()))
    true: dict[tuple[str, str | None], float | None] = {}
    rows = []
    for case, result in found:
        key = case.activity.name, case.predictor
        if FOREKNOWN in result:
            true[key] = result[FOREKNOWN]["distance_m"]
        values = {m: result[m]["distance_m"] for m in result} | {FOREKNOWN: true.get(key)}
        rows.append(
            (
                case.activity.text,
                case.sight.name,
                f"{100 * case.noise_m:g}",
                *((case.predictor or own,) if several else ()),
                *(_metres(values[mode]) for mode in modes),
            )
        )
    return Table("Working distance, m", (*first, *modes), tuple(rows))


def _sets_table(found: Sequence[Found]) -> list[Table]:
    """Compare the first two modes over each requested set; empty without sets or two modes."""
    by_set: dict[str, list[tuple[float, float, str]]] = {}
    modes = list(found[0][1])[:2]
    for case, result in found:
        if case.activity.of_set and len(modes) > 1 and all(mode in result for mode in modes):
            at_m = [result[mode]["distance_m"] for mode in modes]
            first_m, second_m = (FARTHEST_M if m is None else m for m in at_m)
            own = by_set.setdefault(case.activity.of_set, [])
            own.append((first_m, second_m, case.activity.name))
    rows = []
    for name, own in by_set.items():
        worst = max(own, key=lambda each: each[0] - each[1])
        middle_m = (median(first for first, _, _ in own), median(second for _, second, _ in own))
        most = f"{100 * (worst[0] - worst[1]):+.0f} ({worst[2].rpartition('/')[2]})"
        rows.append((name, str(len(own)), *(f"{m:.2f}" for m in middle_m), most))
    header = ("set", "cases", *(f"{mode}, median" for mode in modes), "farther at most, cm")
    title = f"Whole sets, m; {FARTHEST_M:g} m where it is more"
    return [Table(title, header, tuple(rows))] if rows else []


def _metres(distance_m: float | None) -> str:
    return f"over {FARTHEST_M:g}" if distance_m is None else f"{distance_m:.2f}"


def _plain(case: Case, result: dict[str, Any], own: str) -> dict[str, Any]:
    return {
        "activity": case.activity.name,
        "tracker": case.sight.name,
        "noise_m": case.noise_m,
        "predictor": case.predictor or own,
        "modes": result,
    }


def remedies_of(case: Case, found: Waterfall, config: Config) -> list[str]:
    """Return how to reduce each of the largest terms."""
    (variant,) = variants(config, case.modes, ())
    config = with_risk(config, variant)
    sees = np.array(joints_seen(case)).reshape(2, -1)[1]
    unseen = [joint for joint, share in zip(JOINTS, sees, strict=True) if share == 0]
    hidden = [joint for joint in unseen if joint in case.sight.hidden]
    lacking = [joint for joint in unseen if joint not in hidden]
    largest = sorted(TERMS, key=lambda term: -found.costs_m[term.key])[:REDUCED]
    return [
        f"{100 * found.costs_m[term.key]:.0f} cm of the contributions: {term.text}; "
        f"{remedy(term.key, config, lacking, hidden)}."
        for term in largest
        if found.costs_m[term.key] > LEAST_M
    ]


def _terms_table(case: Case, found: Waterfall) -> Table:
    """Return the contribution of each term, and of the rest."""
    assert found.total_m is not None
    title = (
        f"Contributions to the distance: {case.activity.text}, {case.sight.name}, {case.modes[0]}"
    )
    rows = [(term.text, f"{100 * found.costs_m[term.key]:.0f}") for term in TERMS]
    rest = f"rest: {rest_text(case.modes[0])}"
    rows += [(rest, f"{100 * found.rest_m:.0f}"), ("sum", f"{100 * found.total_m:.0f}")]
    return Table(title, ("term", "cm"), tuple(rows))


def _plain_terms(case: Case, found: Waterfall) -> dict[str, Any]:
    return {
        "activity": case.activity.name,
        "tracker": case.sight.name,
        "noise_m": case.noise_m,
        "mode": case.modes[0],
        "total_m": found.total_m,
        "costs_m": found.costs_m,
        "rest_m": found.rest_m,
    }


def _written(out: Path, tables: Sequence[Table], said: Sequence[str], text: str) -> list[Path]:
    notes = "\n".join(f"- {line}" for line in said)
    shown = "\n".join(table.markdown() for table in tables)
    markdown = f"# Working distance\n\n{shown}\n{notes}\n"
    files = [out / "distance.md", out / "distance.json"]
    with writing(f"--out {out}", "name another folder"):
        for path, content in zip(files, (markdown, text + "\n"), strict=True):
            atomic_write(path, content.encode())
    return files
