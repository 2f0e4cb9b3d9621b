"""``check``: examine a configuration before anything moves."""

import json
from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import Annotated, Any, cast

import typer
from rich.console import Console
from rich.table import Table

from hri_predict.base.clock import MonotonicClock
from hri_predict.base.quantities.safe_side import LessSafeSetting
from hri_predict.cli.alerts import hook_facts
from hri_predict.cli.check import commissioned, joint_map, notes, robots, sensor, zones
from hri_predict.cli.check import realtime as machine
from hri_predict.cli.common import JsonOption, without_effect
from hri_predict.contracts import registry
from hri_predict.contracts.link import Transport
from hri_predict.contracts.link_abilities import RefusesOld
from hri_predict.contracts.predictor import Predictor
from hri_predict.operation.foxglove.live import foxglove_sdk
from hri_predict.operation.monitoring.alerts import alert_file
from hri_predict.people.clock.offset_line import MAX_DRIFT
from hri_predict.predictors.thread_runner import PredictionRunner
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.robot_constants import worst_distance
from hri_predict.risk.sets import set_hash
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.assemble import Assembly
from hri_predict.run.config import Config
from hri_predict.run.coverage import zones_text
from hri_predict.run.places import place_notes
from hri_predict.run.review.less_safe import less_safe_settings
from hri_predict.run.starting import SlowStart
from hri_predict.run.ticks_told import race_notes, ticks_facts, ticks_line


def check(
    *,
    config: Annotated[Path, typer.Argument(help="The node's YAML configuration.")],
    touched: Annotated[
        str | None,
        typer.Option(
            help="Check the sensor: x,y,z in the room of the point that a person is touching now."
        ),
    ] = None,
    joint: Annotated[
        str | None, typer.Option(help="The joint that touches; default: a hand, else a wrist.")
    ] = None,
    listen: Annotated[
        float | None,
        typer.Option(
            min=1,
            max=60,
            help="Listen to the source for this many seconds and check that people appear upright.",
        ),
    ] = None,
    realtime: Annotated[
        bool,
        typer.Option("--realtime", help="Check whether this machine can run a steady loop."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Validate a configuration; print the delay budget and each link's load.

    With --touched, compare the point that a person touches with the place
    where the sensor sees the joint. Exit status 1 if they are further apart
    than risk.person_uncertainty_m.

    With --listen, check the people in the source against gravity and the floor. Exit status 1, with
    the correct axes, if they lie in the air, hang upside down or have left and right swapped; also
    if no person's feet show the floor.

    With --realtime, list what this machine lacks for a steady loop and how to set it, and measure
    the wake-up latency of a bare loop. Exit status 1 if a setting under realtime: is not available.

    Exit status 1 also if the cell differs from its commissioned state, or if its commissioning
    failed.

    Example: hri-predict check cell.yaml --touched 0.5,-0.2,0.9
    """
    loaded = configuration.load(config)
    if realtime:
        flags = {"--touched": touched, "--joint": joint, "--listen": listen}
        without_effect(flags, "with --realtime")
        if not machine.show(machine.look(loaded), as_json):
            raise typer.Exit(1)
        return
    without_effect({"--joint": joint if touched is None else None}, "without --touched")
    if touched is not None:
        without_effect({"--listen": listen}, "with --touched")
        if not sensor.show_touch(sensor.measure_touch(loaded, touched, joint), as_json):
            raise typer.Exit(1)
        return
    if listen is not None:
        if not sensor.show(sensor.listen(loaded, listen), loaded, as_json):
            raise typer.Exit(1)
        return
    with SlowStart(), loaded.naming_lines():
        predictor = assemble.build_predictor(loaded)
        found = examine(loaded, predictor)
        found["working_distance"] = zones.distance_facts(loaded, predictor)
    if as_json:
        print(json.dumps(found))
    else:
        _print(found)
    if not commissioned.is_as_commissioned(found["commissioning"]):
        raise typer.Exit(1)


def _print(found: dict[str, Any]) -> None:
    console = Console(markup=False)  # names and sources are the user's, and may hold brackets
    console.print(_delay_table(found))
    console.print(ticks_line(found["ticks"]), highlight=False, soft_wrap=True)
    if found["risk"]["robots"]:
        console.print(_risk_table(found["risk"]))
    for name, facts in found["contact"].items():
        console.print(robots.contact_table(name, facts))
    for table in robots.tool_tables(found["tools"]):
        console.print(table)
    if found["links"]:
        console.print(_load_table(found["links"]))
    console.print(f"zones: {found['zones']}", highlight=False)
    computed = (*zones.engine_lines(found["engine"]), found["loops"])
    shown = (
        *zones.calibration_lines(found["calibration"]),
        *zones.distance_lines(found["working_distance"]),
    )
    for line in (*computed, *shown):
        console.print(line, highlight=False, soft_wrap=True)
    latches = ", ".join(found["latch"]) or "none"
    for each in found["sets"]:
        line = f"configuration set {each['number']} ({each['name']}): hash {each['hash']}"
        console.print(line, highlight=False)
    console.print(f"restart: {found['restart']}; latches: {latches}", highlight=False)
    console.print(f"state file: {found['state'] or 'none'}", highlight=False, soft_wrap=True)
    console.print(
        f"source's clock: up to {found['clock']['max_drift_ppm']:g} ppm of clock drift is "
        f"accepted, plus {found['clock']['wander_s'] * 1e3:g} ms of wander "
        f"(source.clock_wander_s); a delay that grows over hours can make captures look fresher by "
        f"that amount",
        highlight=False,
    )
    for line in (
        *joint_map.joint_map_lines(found["joint_map"]),
        commissioned.evidence_line(found["evidence"]),
        f"alert hooks: {', '.join(hook['name'] for hook in found['alerts']) or 'none'}",
        *commissioned.commissioning_lines(found["commissioning"]),
    ):
        console.print(line, highlight=False, soft_wrap=True, markup=False)
    for each in found["less_safe"]:
        console.print(f"less safe than the default: {LessSafeSetting(**each)}")
    for note in found["notes"]:
        console.print(f"note: {note}")
    as_commissioned = commissioned.is_as_commissioned(found["commissioning"])
    console.print(
        f"{found['path']}: {'ok' if as_commissioned else 'valid, but not as commissioned'}"
    )


def examine(config: Config, predictor: Predictor | None = None) -> dict[str, Any]:
    """Build everything without opening a device; return the budget, distances, loads and notes.

    ``predictor``: the configured one, if it is built already.

    Raises:
        HriPredictError: the configuration is wrong; one line with the remedy.
    """
    clock = MonotonicClock()
    source = assemble.build_source(config)
    # a check touches no device: anything may stand in its place
    wires = {link.name: cast(Transport[Any], object()) for link in config.links}
    predictor = predictor or assemble.build_predictor(config)
    runner = PredictionRunner(predictor, deadline_s=None)
    assembly = assemble.build(config, clock, source=source, transports=wires, prediction=runner)
    loads = [assemble.load_of(config, link) for link in config.links]
    simulated = [link for link in config.links if link.simulate is not None]
    if simulated:  # built but not started: this checks its settings
        registry.load("cells", "mock")(
            links=simulated, robots=config.node.robots, base_dir=config.base_dir, clock=clock
        )
    alert_file(config.node.alerts, config.base_dir)
    if config.node.foxglove is not None:
        foxglove_sdk()
    alerts = hook_facts(config)
    budget = assemble.build_budget(config, source)
    stops = {
        model.name: model.stopping(settings.max_speed_m_s)
        for model, settings in zip(assembly.robots, config.node.robots, strict=True)
    }
    terms = dict(budget.terms())
    oldest_s = budget.oldest_s([robot.name for robot in config.node.robots])
    terms["controller_reaction"] = terms.pop("reaction")  # one part of T_r, not all of it
    risk = _risk_needs(config, assembly, budget)
    calibration = zones.calibration_facts(config, date.today())
    pairs = list(zip(config.node.robots, assembly.robots, strict=True))
    contact = config.node.risk, pairs, config.base_dir
    evidence = commissioned.evidence_facts(config)
    needed = {
        model.name: (model, risk["robots"][model.name]["protective_distance_m"])
        for model in assembly.robots
    }
    return {
        "path": str(config.path),
        "ticks": ticks_facts(config.node, source.rate_hz),
        "delay_budget_s": terms,
        "reaction_time_s": sum(terms.values()),
        "refuse_advice_older_than_s": dict(oldest_s),
        "max_age_s": {
            link.name: completed.max_age_s
            for link in config.links
            if isinstance(completed := assemble.completed(config, link), RefusesOld)
        },
        "stopping": {name: {"time_s": t, "distance_m": d} for name, (t, d) in stops.items()},
        "until_stopped_s": {
            name: budget.reaction_s(budget.stale_s, name) + t for name, (t, _) in stops.items()
        },
        "horizon_s": predictor.horizon_steps / predictor.rate_hz,
        "engine": zones.engine_facts(predictor, config.predictor),
        "loops": zones.loops_line(),
        "risk": risk,
        "contact": robots.contact_facts(*contact),
        "tools": robots.tool_facts(assembly.robots, config.node.robots),
        "links": [asdict(load) for load in loads],
        "zones": zones_text(config),
        "calibration": calibration,
        "joint_map": joint_map.joint_map_cost(config, predictor, source.joint_map),
        "latch": list(config.node.risk.latch),
        "restart": config.node.risk.restart,
        "sets": [
            {"number": each.number, "name": each.name, "hash": set_hash(each, config.node.zones)}
            for each in config.node.risk.sets
        ],
        "state": notes.state_path(config),
        "clock": {"max_drift_ppm": MAX_DRIFT * 1e6, "wander_s": config.source.clock_wander_s},
        "evidence": evidence,
        "alerts": alerts,
        "commissioning": commissioned.commissioning_facts(config),
        "less_safe": [asdict(each) for each in less_safe_settings(config)],
        "notes": [
            *(note for robot in config.node.robots for note in notes.mode_notes(robot)),
            *notes.still_note(config.node.robots, config.node.risk.mode),
            *notes.general_notes(config),
            *notes.delay_notes(config),
            *race_notes(config.node, source.rate_hz),
            *commissioned.evidence_notes(evidence),
            *(f"alerts: {note}" for hook in alerts for note in hook["notes"]),
            *notes.gravity_note(config, source.joint_map),
            *notes.lost_notes(config, needed, source.rate_hz),
            *notes.first_start_note(config),
            *notes.radius_note(risk),
            *robots.base_notes(config.node.robots),
            *place_notes(config, assembly.robots),
            *zones.calibration_notes(calibration),
            *robots.contact_notes(*contact),
            *robots.unseen_ends_note(config.node.risk, assembly.source.joint_map.mapped),
        ],
    }


def _risk_needs(config: Config, assembly: Assembly, budget: DelayBudget) -> dict[str, Any]:
    """Return the mode, and each robot's required distance at full speed and longest delay."""
    risk, needs = config.node.risk, {}
    for settings, model in zip(config.node.robots, assembly.robots, strict=True):
        worst = worst_distance(risk, settings, model, budget)
        needs[settings.name] = {
            **asdict(worst),
            "protective_distance_m": worst.total,
            "reach_m": model.reach_m,
            "fixed_radius_m": risk.fixed_radius_m or model.reach_m + worst.total,
        }
    return {"mode": risk.mode, "robots": needs}


_TERMS = {
    "s_h": "S_h: distance the person covers until the robot has stopped",
    "s_r": "S_r: distance the robot covers until it brakes",
    "s_s": "S_s: distance the robot covers while braking",
    "c": "C: risk.intrusion_m",
    "z_d": "Z_d: risk.person_uncertainty_m",
    "z_r": "Z_r: risk.robot_uncertainty_m",
}


def _risk_table(risk: dict[str, Any]) -> Table:
    """Return the distances that the risk mode needs."""
    title = f"Risk mode {risk['mode']}, at full speed and the longest delay"
    table = Table(title=title, title_justify="left")
    table.add_column("distance, m")
    for name in risk["robots"]:
        table.add_column(name, justify="right")
    rows = _TERMS | {"protective_distance_m": "S_p: protective separation distance"}
    if risk["mode"] == "fixed":
        rows |= {"reach_m": "the robot's reach", "fixed_radius_m": "radius of the circle"}
    for key, text in rows.items():
        table.add_row(text, *(f"{needs[key]:.3f}" for needs in risk["robots"].values()))
    return table


_DELAYS = {
    "age": "age of the input at the tick",
    "encoding": "tick to encoding",
    "cycle": "one cycle",
    "link_delay": "link: delay_s plus one frame on the wire",
    "silence_timeout": "controller: silence_timeout_s",
    "controller_reaction": "controller: reaction_s until it brakes",
}


def _delay_table(found: dict[str, Any]) -> Table:
    table = Table(title="Delay budget (worst case)", title_justify="left", show_header=False)
    for name, seconds in found["delay_budget_s"].items():
        table.add_row(_DELAYS[name], f"{seconds * 1e3:.0f} ms")
    total_ms = found["reaction_time_s"] * 1e3
    table.add_row("T_r: reaction time, capture to braking", f"{total_ms:.0f} ms", end_section=True)
    for whose, oldest_s in _oldest(found["refuse_advice_older_than_s"]):
        table.add_row(f"{whose}: reject advice older than", f"{oldest_s * 1e3:.0f} ms")
    for link, max_age_s in found["max_age_s"].items():
        table.add_row(f"link {link} itself rejects advice older than", f"{max_age_s * 1e3:.0f} ms")
    table.add_section()
    for robot, stop in found["stopping"].items():
        table.add_row(
            f"{robot}: stopping from full speed, T_s",
            f"{stop['time_s'] * 1e3:.0f} ms over {stop['distance_m'] * 1e3:.0f} mm",
        )
        total = found["until_stopped_s"][robot]
        table.add_row(f"{robot}: until it has stopped, T_r + T_s", f"{total * 1e3:.0f} ms")
    table.add_row("horizon of the forecast", f"{found['horizon_s'] * 1e3:.0f} ms")
    return table


def _oldest(by_link: dict[str, float]) -> list[tuple[str, float]]:
    """Return whose controllers have which limit: one row if all have the same."""
    if len({round(limit_s, 6) for limit_s in by_link.values()}) == 1:
        return [("controllers", next(iter(by_link.values())))]
    return [(f"controller on link {link}", limit_s) for link, limit_s in by_link.items()]


def _load_table(links: list[dict[str, Any]]) -> Table:
    table = Table(title="Link load", title_justify="left")
    table.add_column("link")
    table.add_column("load", justify="right")
    table.add_column("remaining for zones and poses", justify="right")
    table.add_column("by message")
    for link in links:
        details = ", ".join(f"{k} {100 * v:.1f} %" for k, v in link["details"].items())
        table.add_row(
            link["name"], f"{100 * link['load']:.1f} %", f"{100 * link['spare']:.1f} %", details
        )
    return table
