"""Thousands of closed-loop episodes: ``hri-predict simulate``."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import ConfigError, UnusableRecordingError
from hri_predict.base.files import YAML_ENDINGS, read_text
from hri_predict.base.skeleton import JOINTS
from hri_predict.base.work.identity import code_digest, digests
from hri_predict.base.work.workers_for import workers_for
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import PredictorSettings
from hri_predict.recording.recording import names_of
from hri_predict.run.compared_predictors import basis_of, demand_use
from hri_predict.run.config import Config
from hri_predict.run.session import VIRTUAL_START_NS
from hri_predict.run.zone_basis import ZoneBasis
from hri_predict.zones.predictor_identity import identity
from hri_sim.simulation.approach import ApproachSource, map_of, together
from hri_sim.simulation.bodies import engines_of
from hri_sim.simulation.cell import Cell, Variant, variants, with_risk
from hri_sim.simulation.inputs import named_digests, read_files, recorded
from hri_sim.simulation.motion import Motion, load_motion
from hri_sim.simulation.request import SimulationReport, SimulationRequest
from hri_sim.simulation.results.publish import Result, report
from hri_sim.simulation.results.report import Judged, Row, judged
from hri_sim.simulation.results.rows import are_of
from hri_sim.simulation.scenario import draw
from hri_sim.simulation.store import Store
from hri_sim.simulation.work import (
    ALONE,
    Block,
    SimulationPlan,
    SourceValue,
    blocks,
    episodes,
    run_block,
)

__all__ = ["Result", "report", "run", "simulate"]

log = logging.getLogger(__name__)

CHECKED_SHARE = 0.02
CHECKED_LEAST = 3


def run(request: SimulationRequest, progress: Callable[[int, int], None]) -> SimulationReport:
    """A simulation to run; see ``hri-predict simulate``."""
    return report(simulate(request, progress), request.out)


def simulate(request: SimulationRequest, progress: Callable[[int, int], None]) -> Result:
    """Run (or finish) a simulation.

    Args:
        request: the simulation to run.
        progress: called with the number of finished episodes and the total.

    Raises:
        HriPredictError: the simulation cannot start; one line with the remedy.
    """
    plan = _plan(request)
    for name in plan.names:  # report errors before anything starts
        config = plan.loaded(name)
        cell = Cell(config)
        modes = variants(config, plan.modes, plan.coverages)
    settings = {plan.asked(name).label: _settings(plan.loaded(name)) for name in plan.names}
    demand_use(request.calibrations, settings)
    plan, left_out = _usable(plan, cell, modes)
    store = Store(request.out, _decided_by(plan), request.resume)
    todo = _todo(plan, store, [ALONE.name, *(variant.name for variant in modes)])
    total = plan.episodes * len(plan.names)
    done = total - sum(len(episodes(plan, block)) for block in todo)
    progress(done, total)
    jobs = request.jobs if len(todo) > 1 else 1
    with workers_for(jobs, request.cluster, _reads(plan)) as workers:
        for place, rows in workers.each(run_block, [(plan, block) for block in todo]):
            store.add(todo[place].key, rows)
            done += len(episodes(plan, todo[place]))
            progress(done, total)
    return _result(plan, store, left_out)


def _todo(plan: SimulationPlan, store: Store, variants: Sequence[str]) -> list[Block]:
    """Return the blocks to run: also those whose finished rows are not of their episodes."""
    todo, foreign = [], []
    for block in blocks(plan):
        rows = store.done.get(block.key)
        if rows is not None and not are_of(rows, episodes(plan, block), variants):
            foreign.append(block.key)
            del store.done[block.key]
            rows = None
        if rows is None:
            todo.append(block)
    if foreign:
        log.warning(
            "--resume: block %s holds something other than its episodes (%d in all); run again",
            foreign[0],
            len(foreign),
        )
    return todo


def _plan(request: SimulationRequest) -> SimulationPlan:
    if not request.motions:
        raise ConfigError("--data: name at least one recording")
    per = max(CHECKED_LEAST, round(CHECKED_SHARE * request.episodes))
    rng = np.random.default_rng([request.seed, 1])
    chosen = rng.choice(request.episodes, min(per, request.episodes), replace=False)
    names = request.predictors or (None,)
    checked = frozenset((name, int(index)) for name in names for index in chosen)
    return SimulationPlan(**vars(request), checked=checked)


def _decided_by(plan: SimulationPlan) -> dict[str, Any]:
    """Return everything that determines the results; recordings by name, not by folder."""
    return {
        "config": plan.loaded(None).text,
        "predictors": [_decides(plan, name) for name in plan.names],
        "modes": plan.modes,
        "coverages": plan.coverages,
        "motions": names_of([Path(name) for name in plan.motions]),
        "recordings": list(digests(recorded(plan.motions)).values()),
        "files": [named_digests(plan.loaded(name)) for name in plan.names],
        "joint_map": _text(plan.joint_map),
        "seen": [[key, _text(v) if isinstance(v, str) else v] for key, v in plan.seen],
        "episodes": plan.episodes,
        "seed": plan.seed,
        "people": plan.people,
        "code": code_digest(),
    }


def _settings(config: Config) -> PredictorSettings:
    return config.predictor.resolved(config.base_dir)


def _decides(plan: SimulationPlan, predictor: str | None) -> list[Any]:
    """Return what determines a predictor's results: name, settings, code and calibration."""
    config = plan.loaded(predictor)
    settings = _settings(config)
    beside = config.node.risk.coverage.calibration
    text = None if beside is None else read_text(config.base_dir / beside, "calibration")
    code = registry.code_of(settings)
    return [plan.asked(predictor).label, settings.name, identity(settings), code, text]


def _basis(plan: SimulationPlan, predictor: str | None) -> ZoneBasis:
    """Return the basis of a predictor's zones."""
    config = plan.loaded(predictor)
    coverage = config.node.risk.coverage
    return basis_of(plan.asked(predictor), _settings(config), coverage, config.base_dir)


def _said(value: SourceValue) -> str | float:
    """Return a value of the source in the form used by the report."""
    if isinstance(value, tuple):
        return ", ".join(value)
    return Path(value).name if isinstance(value, str) else value


def _text(joint_map: str | None) -> str | None:
    """Return the content of a joint map, or its name if it is shipped."""
    own = joint_map is not None and joint_map.endswith(YAML_ENDINGS)
    return read_text(Path(joint_map), "joint map") if own and joint_map else joint_map


def _reads(plan: SimulationPlan) -> list[Path]:
    """Return the files that determine an episode, except for those of the installation."""
    configs = [plan.loaded(name) for name in plan.names]
    return read_files(configs, [*recorded(plan.motions), *plan.calibrations])


def _usable(
    plan: SimulationPlan, cell: Cell, modes: Sequence[Variant]
) -> tuple[SimulationPlan, list[str]]:
    """Return the plan with the playable recordings, and a line for each of the others.

    Raises:
        HriPredictError: a recording cannot be read, or none is left.
    """
    base_dir, rate_hz = cell.config.base_dir, cell.source.rate_hz
    motions, left_out = [], []
    names = names_of([Path(name) for name in plan.motions])
    for index, (name, short) in enumerate(zip(plan.motions, names, strict=True)):
        try:
            motion = load_motion(name, rate_hz, base_dir, cell.source.joint_map)
            _demand_seen(motion, cell)
            _demand_fast(motion, cell, modes)
            draw(
                seed=plan.seed,
                index=index,
                motions=[motion],
                workspace=cell.workspace,
                lead_in_s=cell.source.lead_in_s,
            )
        except UnusableRecordingError as error:
            why = str(error).removesuffix("; leave it out")
            log.warning("%s; left out", why)
            left_out.append(why.replace(name, short))  # a report needs no folder of one machine
        else:
            motions.append(motion)
    if not motions:
        raise ConfigError(f"--data: no recording is left: {left_out[0]}; give others")
    if plan.people > 1:
        together(motions)
    return replace(plan, motions=tuple(motion.name for motion in motions)), left_out


def _demand_seen(motion: Motion, cell: Cell) -> None:
    """Check that the tracker of ``source.tracker`` delivers a joint of this recording.

    Raises:
        UnusableRecordingError: it delivers none, so the node would see no person.
    """
    source = cell.source
    able = map_of([motion], source.tracker, cell.config.base_dir, source.lacks).mapped
    if not (able & ~np.isin(JOINTS, source.hidden)).any():
        raise UnusableRecordingError(
            f"recording {motion.name}: tracker {source.tracker} sees none of its joints; leave it "
            f"out"
        )


def _demand_fast(motion: Motion, cell: Cell, modes: Sequence[Variant]) -> None:
    """Check that a node can work with the capture rate of a recording.

    Raises:
        UnusableRecordingError: it cannot: its knowledge would be too old by the time the robot has
            stopped.
    """
    if motion.rate_hz >= cell.source.rate_hz:
        return
    settings = cell.source.model_copy(
        update={"motions": [motion.name], "places": [[0.0, 0.0, 0.0]]}
    )
    source = ApproachSource(settings, cell.config.base_dir)
    try:
        engines_of(cell, source, VirtualClock(VIRTUAL_START_NS), modes)
    except ConfigError as error:
        raise UnusableRecordingError(
            f"recording {motion.name}: {motion.rate_hz:.3g} captures a second are too few; {error}"
        ) from error


def _result(plan: SimulationPlan, store: Store, left_out: Sequence[str]) -> Result:
    results, predictions, checks, disagreements = [], {}, 0, []
    alone: Judged | None = None
    for number, predictor in enumerate(plan.names):
        config = plan.loaded(predictor)
        name = plan.asked(predictor).label
        mine = [store.done[b.key] for b in blocks(plan) if b.predictor == number]
        outcomes = [row for rows in mine for row in rows["outcomes"]]
        modes = variants(config, plan.modes, plan.coverages)
        for variant in modes:
            chosen = [row for row in outcomes if row["variant"] == variant.name]
            results.append(judged(name, variant.name, _sorted(chosen)))
        if alone is None:
            chosen = [row for row in outcomes if row["variant"] == ALONE.name]
            alone = judged("–", ALONE.name, _sorted(chosen))
        predictions[name] = _sorted([row for rows in mine for row in rows["predictions"]])
        for check in (row for rows in mine for row in rows["checks"]):
            checks += 1
            if check["disagreement"]:
                disagreements.append(
                    f"{name}, {check['variant']}, episode {check['index']}: {check['disagreement']}"
                )
    assert alone is not None
    risks = [with_risk(config, each).node.risk for each in modes]
    forecasts = any(risk.uses_forecasts for risk in risks)  # otherwise no zone rests on them
    asked = {
        "configuration": plan.config.name,
        "episodes": plan.episodes,
        "seed": plan.seed,
        "people": plan.people,
        **{key: _said(value) for key, value in plan.seen},
        "recordings": names_of([Path(name) for name in plan.motions]),
        "folders": sorted({"/".join(Path(name).parts[-3:-1]) for name in plan.motions} - {""}),
    }
    return Result(
        results=results,
        alone=alone,
        predictions=predictions,
        checks=checks,
        disagreements=disagreements,
        asked=asked,
        left_out=left_out,
        bases=[_basis(plan, name) for name in plan.names] if forecasts else [],
    )


def _sorted(rows: Sequence[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: row["index"])
