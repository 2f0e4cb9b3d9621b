"""``check`` and ``predictors``: what a configuration means, before anything moves."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from hri_predict import assemble, registry
from hri_predict import config as configuration
from hri_predict.alerts import alert_file
from hri_predict.assemble import Assembly
from hri_predict.cli.touch import measure_touch, show_touch
from hri_predict.clock import MonotonicClock
from hri_predict.config import Config
from hri_predict.errors import HriPredictError
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.robot_judge import worst_distance


def check(
    config: Annotated[Path, typer.Argument(help="The node's YAML configuration.")],
    touched: Annotated[
        str | None,
        typer.Option(help="x,y,z in the room that a person touches now: is the sensor right?"),
    ] = None,
    joint: Annotated[str, typer.Option(help="The joint that touches.")] = "r_hand",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON alone.")] = False,
) -> None:
    """Validate a configuration; print the delay budget and each link's load.

    With --touched, compare a point that a person touches with where the sensor sees the hand; exit
    status 1 if that is further off than risk.person_uncertainty_m.

    Example: hri-predict check cell.yaml --touched 0.5,-0.2,0.9
    """
    loaded = configuration.load(config)
    if touched is not None:
        if not show_touch(measure_touch(loaded, touched, joint), as_json):
            raise typer.Exit(1)
        return
    found = examine(loaded)
    if as_json:
        print(json.dumps(found))
        return
    console = Console()
    console.print(_delay_table(found))
    if found["risk"]["robots"]:
        console.print(_risk_table(found["risk"]))
    if found["links"]:
        console.print(_load_table(found["links"]))
    console.print(f"zones: {found['zones']}", highlight=False)
    for note in found["notes"]:
        console.print(f"note: {note}")
    console.print(f"{found['path']}: fine")


def examine(config: Config) -> dict[str, Any]:
    """Build everything without opening a device, and say what it comes to.

    Raises:
        HriPredictError: something is wrong; one line with the remedy.
    """
    clock = MonotonicClock()
    source = assemble.build_source(config)
    transports = {link.name: object() for link in config.links}  # nothing is opened
    assembly = assemble.build(config, clock, source=source, transports=transports)
    loads = [
        registry.load("links", link.kind).load(
            link, config.node.rate_hz, [0] * len(assembly.robots)
        )
        for link in config.links
    ]
    simulated = [link for link in config.links if link.simulate is not None]
    if simulated:  # not started: to be built, its settings must be right
        registry.load("cells", "mock")(simulated, config.node.robots, config.base_dir, clock, 1.0)
    alert_file(config.node.alerts, config.base_dir)
    budget = assemble.build_budget(config, source)
    stops = {
        model.name: model.stopping(settings.max_speed_m_s)
        for model, settings in zip(assembly.robots, config.node.robots, strict=True)
    }
    terms = dict(budget.terms())
    reaction_time_s = sum(terms.values())
    terms["controller_reaction"] = terms.pop("reaction")  # one part of T_r, not all of it
    risk = _risk_needs(config, assembly, budget)
    return {
        "path": str(config.path),
        "delay_budget_s": terms,
        "reaction_time_s": reaction_time_s,
        "refuse_advice_older_than_s": reaction_time_s - terms["controller_reaction"],
        "stopping": {name: {"time_s": t, "distance_m": d} for name, (t, d) in stops.items()},
        "until_stopped_s": {name: reaction_time_s + t for name, (t, _) in stops.items()},
        "horizon_s": assembly.prediction.predictor.horizon_steps
        / assembly.prediction.predictor.rate_hz,
        "risk": risk,
        "links": [asdict(load) for load in loads],
        "zones": _zones(config),
        "notes": [*_notes(config), *_radius_note(risk)],
    }


def _zones(config: Config) -> str:
    """What the zones rest on, in a line: never more than was measured."""
    risk, name = config.node.risk, config.predictor.name
    if risk.mode != "predictive":
        return f"mode {risk.mode} uses no forecast"
    calibration = assemble.build_calibration(config)
    if calibration is None:
        return (
            f"not calibrated for {name} as it is set: how often they hold people is not known; "
            f"see hri-predict calibrate"
        )
    coverage = risk.coverage
    held = "each joint" if coverage.of == "joint" else "the whole body"
    check = "checked live" if coverage.self_check else "not checked live"
    return (
        f"calibrated on {len(calibration.recordings)} recordings to hold {held} in "
        f"{100 * coverage.level:g} % ({coverage.basis}), {check}"
    )


def _risk_needs(config: Config, assembly: Assembly, budget: DelayBudget) -> dict[str, Any]:
    """The mode, and per robot the distance that it needs at full speed and the longest delay."""
    risk, robots = config.node.risk, {}
    for settings, model in zip(config.node.robots, assembly.robots, strict=True):
        worst = worst_distance(risk, settings, model, budget)
        robots[settings.name] = {
            **asdict(worst),
            "protective_distance_m": worst.total,
            "reach_m": model.reach_m,
            "fixed_radius_m": risk.fixed_radius_m or model.reach_m + worst.total,
        }
    return {"mode": risk.mode, "robots": robots}


def _notes(config: Config) -> list[str]:
    notes = []
    if not config.links:
        notes.append("no links: nobody hears the advice; add 'links:'")
    if any(link.simulate for link in config.links):
        notes.append("simulated links: mock controllers, no hardware")
    notes += [f"link {link.name}: {note}" for link in config.links for note in link.notes]
    notes += [f"source {config.source.kind}: {note}" for note in config.source.notes]
    if config.source.field_of_view is None:
        notes.append("no source.field_of_view: the whole room counts as seen")
    if config.node.risk.intrusion_m == 0:
        notes.append("risk.intrusion_m, C, is 0: right only if the sensor sees even fingers")
    if unused := assemble.unused_coverage(config):
        notes.append(unused)
    if config.node.robots and any(r.motion.kind == "standing" for r in config.node.robots):
        notes.append("a robot with motion 'standing' is taken to stand still for ever")
    return notes


def _radius_note(risk: dict[str, Any]) -> list[str]:
    """Circles that were set, and set too small even for a robot that stays within its reach."""
    if risk["mode"] != "fixed":
        return []
    notes = []
    for name, needs in risk["robots"].items():
        least = needs["reach_m"] + sum(needs[term] for term in ("s_h", "c", "z_d", "z_r"))
        if needs["fixed_radius_m"] < least:
            notes.append(
                f"risk.fixed_radius_m {needs['fixed_radius_m']:g} is below the reach of robot"
                f" {name} + S_h + C + Z_d + Z_r, {least:.2f} m: who walks in may be touched before"
                " it stands"
            )
    return notes


_TERMS = {
    "s_h": "S_h: the person, until the robot stands",
    "s_r": "S_r: the robot, until it brakes",
    "s_s": "S_s: the robot's braking",
    "c": "C: risk.intrusion_m",
    "z_d": "Z_d: risk.person_uncertainty_m",
    "z_r": "Z_r: risk.robot_uncertainty_m",
}


def _risk_table(risk: dict[str, Any]) -> Table:
    """What the risk mode needs of the room."""
    table = Table(
        title=f"Risk mode {risk['mode']}: at full speed and the longest delay", title_justify="left"
    )
    table.add_column("distance, m")
    for name in risk["robots"]:
        table.add_column(name, justify="right")
    rows = _TERMS | {"protective_distance_m": "S_p: protective separation distance"}
    if risk["mode"] == "fixed":
        rows |= {"reach_m": "the robot's reach", "fixed_radius_m": "radius of the circle"}
    for key, text in rows.items():
        table.add_row(text, *(f"{needs[key]:.2f}" for needs in risk["robots"].values()))
    return table


_DELAYS = {
    "age": "age of the input at the tick",
    "encoding": "from the tick to encoding",
    "cycle": "one cycle",
    "link_delay": "link: delay_s, and a frame on the wire",
    "silence_timeout": "controller: silence_timeout_s",
    "controller_reaction": "controller: reaction_s until it brakes",
}


def _delay_table(found: dict[str, Any]) -> Table:
    table = Table(title="Delay budget (worst case)", title_justify="left", show_header=False)
    for name, seconds in found["delay_budget_s"].items():
        table.add_row(_DELAYS[name], f"{seconds * 1e3:.0f} ms")
    total_ms = found["reaction_time_s"] * 1e3
    table.add_row("T_r: reaction time, capture to braking", f"{total_ms:.0f} ms", end_section=True)
    table.add_row(
        "controllers: refuse advice older than",
        f"{found['refuse_advice_older_than_s'] * 1e3:.0f} ms",
        end_section=True,
    )
    for robot, stop in found["stopping"].items():
        table.add_row(
            f"{robot}: stopping at full speed, T_s",
            f"{stop['time_s'] * 1e3:.0f} ms over {stop['distance_m'] * 1e3:.0f} mm",
        )
        total = found["until_stopped_s"][robot]
        table.add_row(f"{robot}: until it stands, T_r + T_s", f"{total * 1e3:.0f} ms")
    table.add_row("forecast's horizon", f"{found['horizon_s'] * 1e3:.0f} ms")
    return table


def _load_table(links: list[dict[str, Any]]) -> Table:
    table = Table(title="Link load", title_justify="left")
    table.add_column("link")
    table.add_column("load", justify="right")
    table.add_column("left for zones and poses", justify="right")
    table.add_column("made of")
    for link in links:
        details = ", ".join(f"{k} {100 * v:.1f} %" for k, v in link["details"].items())
        table.add_row(
            link["name"], f"{100 * link['load']:.1f} %", f"{100 * link['spare']:.1f} %", details
        )
    return table


def predictors(
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON alone.")] = False,
) -> None:
    """List the predictors there are.

    Example: hri-predict predictors
    """
    rows = [_predictor_row(name) for name in registry.names("predictors")]
    if as_json:
        print(json.dumps(rows))
        return
    table = Table()
    table.add_column("predictor", no_wrap=True)
    table.add_column("what it does")
    table.add_column("its weights")
    for row in rows:
        table.add_row(row["name"], row["about"], _weights_text(row["weights"]))
    Console().print(table)


def _predictor_row(name: str) -> dict[str, Any]:
    """What is known of a predictor, and of its shipped weights where it is a trained one."""
    row: dict[str, Any] = {"name": name, "about": "", "weights": None}
    try:
        cls = registry.load("predictors", name)
        row["about"] = (cls.__doc__ or "").strip().partition("\n")[0].replace("``", "")
        # one around another predictor takes that one's
        if hasattr(cls, "network_class") and "inner" not in cls.settings_model.model_fields:
            row["weights"] = _shipped(name)
    except HriPredictError as error:  # one that is broken must not hide the others
        row["about"] = f"cannot be used: {error}"
    return row


def _shipped(name: str) -> dict[str, Any]:
    """What the shipped weights of a trained predictor say of themselves."""
    from hri_predict.predictors.neural import shipped_weights  # with torch, which takes seconds
    from hri_predict.predictors.weights import read_header

    path = shipped_weights(name)
    if not path.exists():
        return {"path": None}
    header = read_header(path)
    rate_hz = header.shape.rate_hz
    validation = header.card.get("validation")
    return {
        "path": str(path),
        "rate_hz": rate_hz,
        "history_s": header.shape.history_steps / rate_hz,
        "horizon_s": header.shape.horizon_steps / rate_hz,
        "validation_mm": validation.get("mpjpe_mm") if isinstance(validation, dict) else None,
    }


def _weights_text(weights: dict[str, Any] | None) -> str:
    if weights is None:
        return ""
    if weights["path"] is None:
        return "none shipped: name yours in predictor.weights"
    text = (
        f"{weights['rate_hz']:g} Hz, {weights['history_s']:.2g} s of history, "
        f"{weights['horizon_s']:.2g} s ahead"
    )
    error_mm = weights["validation_mm"]
    return text if error_mm is None else f"{text}, {error_mm:.0f} mm off on validation"
