"""Notes of ``check``: points in a configuration that the cell's integrator should know."""

from collections.abc import Mapping, Sequence
from typing import Any

from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.link_abilities import RefusesOld
from hri_predict.contracts.repetition import HEARD_LATE_S, LOST_MESSAGES, lost_without_silence
from hri_predict.node.memory import demand_state_file
from hri_predict.operation.alerting.settings import is_loopback
from hri_predict.people.body.posture import shows_down
from hri_predict.people.lost.free_space import BODY_M, CELL_M
from hri_predict.risk.areas import floor_distance
from hri_predict.robots.model import RobotModel, RobotSettings, StateMotion, TrajectoryMotion
from hri_predict.run import assemble
from hri_predict.run.advised import advised, age_limits_s
from hri_predict.run.config import Config
from hri_predict.run.coverage import unused_coverage
from hri_predict.zones.lost_places import ARM_M

# -- notes on the delays that the configuration assumes of links and controllers -------------------

PLC_CYCLE_S = 0.01
_OF_CONTROLLER = ("silence_timeout_s", "reaction_s")


def delay_notes(config: Config) -> list[str]:
    """Return a note for each link with delays that are missing or unrealistic."""
    notes = []
    for link in config.links:
        notes += _assumed(link) if link.advises else []
        notes += _too_short(link, 1.0 / config.node.rate_hz) if link.advises else []
    return notes + _too_old(config)


def _assumed(link: LinkSettings) -> list[str]:
    """Return a note if the controller's times are defaults: the real one may be slower."""
    unset = [key for key in _OF_CONTROLLER if key not in link.model_fields_set]
    if not unset or link.simulate is not None:
        return []
    times = " and ".join(f"{key} {getattr(link, key) * 1e3:g} ms" for key in unset)
    return [
        f"link {link.name}: {times} not set, so T_r assumes a controller as fast as a PLC with a "
        f"cycle of {PLC_CYCLE_S * 1e3:g} ms. Measure its times (docs/guides/plc.md), set both "
        "keys, and program the same time-out there (cells of version 0.2: docs/guides/upgrade.md)"
    ]


def _too_short(link: LinkSettings, cycle_s: float) -> list[str]:
    """Return a note if the controller receives messages too rarely for its time-out."""
    interval_s = min(link.repeat_s, cycle_s)
    lost = lost_without_silence(link.silence_timeout_s, interval_s)
    if lost >= LOST_MESSAGES:
        return []
    heard = f"Status and Advice every {interval_s * 1e3:.3g} ms"
    needed_s = HEARD_LATE_S + (LOST_MESSAGES + 1) * interval_s
    effect = (
        "the controller may stop between two of them"
        if lost < 0
        else "each that is lost or late stops the robot"
        if lost == 0
        else "two lost in a row stop the robot"
    )
    return [
        f"link {link.name}: silence_timeout_s {link.silence_timeout_s * 1e3:g} ms is short for "
        f"{heard}: {effect}; raise it to {needed_s:.2g} s (in the controller, too), or repeat_hz"
    ]


def _too_old(config: Config) -> list[str]:
    """Return a note for each link that accepts advice older than T_r assumes."""
    limits = {
        link.name: link.max_age_s
        for link in config.links
        if isinstance(link, RefusesOld) and link.max_age_s is not None
    }
    if not limits:
        return []
    budget = assemble.build_budget(config, assemble.build_source(config, with_faults=False))
    return [
        f"link {name}: max_age_s {limits[name] * 1e3:g} ms permits motion on advice older than T_r "
        f"assumes, so a person may come closer than the separation distance; set it to "
        f"{longest_s:g}, or leave it out"
        for name, longest_s in age_limits_s(config, budget).items()
        if limits.get(name, 0.0) > longest_s
    ]


# -- notes of check on operating modes, and on how the node knows where its robots are -------------


def mode_notes(robot: RobotSettings) -> list[str]:
    """Return a warning for each mode that this robot allows, and one if a file moves it."""
    modes, notes = robot.modes, []
    if isinstance(robot.motion, TrajectoryMotion):
        notes.append(
            f"robot {robot.name}: motion.kind trajectory: the file says where it is, regardless "
            "of the advice; a robot that obeys the advice soon deviates from it (its place is then "
            "unknown if its controller sends RobotState; if not, it is wrong, a danger): set "
            "motion: {kind: state} for it"
        )
    if modes.teach is not None:
        notes.append(
            f"robot {robot.name}: TEACH is allowed: in manual mode, while the enabling device is "
            f"held, people and zones do not stop it, up to {modes.teach.speed_m_s:g} m/s; the "
            "enabling device must also be wired to the robot's own safety controller"
        )
    if modes.recovery is not None:
        notes.append(
            f"robot {robot.name}: RECOVERY is allowed: near people it may move back along its plan "
            f"at up to {modes.recovery.speed_m_s:g} m/s, as long as no link gets closer to a person"
        )
    if modes.muting is not None:
        limit = modes.muting.speed_m_s or robot.max_speed_m_s
        notes.append(
            f"robot {robot.name}: MUTING is allowed: for up to {modes.muting.max_s:g} s no person "
            f"stops it, at up to {min(limit, robot.max_speed_m_s):g} m/s; the time is available "
            f"again after "
            f"{modes.muting.recovery_s:g} s without a request, so people may be ignored for "
            f"{modes.muting.share:.0%} of the time; they must be protected by other means"
        )
    return notes


def still_note(robots: Sequence[RobotSettings], mode: str) -> list[str]:
    """Return a note on robots whose frozen RobotState is accepted while they are at rest.

    In mode ``fixed``, it does not matter where an arm is within its reach.
    """
    believed = [
        robot.name
        for robot in robots
        if isinstance(robot.motion, StateMotion)
        and robot.motion.still_s is None
        and (mode != "fixed" or robot.base is not None)
    ]
    if not believed:
        return []
    return [
        f"{', '.join(believed)}: a RobotState that freezes while the robot is at rest is not "
        "noticed when the robot moves on; motion.still_s notices it, and also stops a robot that "
        "waits for longer while people are within its reach"
    ]


# -- notes of check on how lost people end, and on shadows that keep a robot waiting ---------------

PAGE = "docs/guides/lost-people.md"


def lost_notes(
    config: Config, robots: Mapping[str, tuple[RobotModel, float]], rate_hz: float
) -> list[str]:
    """Return notes for the cell's integrator, one line each.

    Args:
        config: the configuration.
        robots: by name, each robot and its separation distance at the highest speed, metres.
        rate_hz: scenes per second.
    """
    source, people = config.source, config.node.people
    found = f"{people.found_within_s:g} s"
    if not source.sees_free_space:
        ends = ["an Acknowledge"]
        ends += ["an exit"] if people.exits else []
        ends += ["the same id"] if source.keeps_ids else []
        return [
            f"a person who vanishes for longer than {found} stays lost until {_listed(ends)} ends "
            f"it; see {PAGE}"
        ]
    notes = []
    if not source.viewpoints:
        notes.append(
            "source.sees_free_space without viewpoints: no space counts as seen free while a "
            "person is in view"
        )
    walked_m = people.lost_speed_m_s * people.free_captures / rate_hz
    around_m = ARM_M + BODY_M + CELL_M + walked_m
    for i, shadow in enumerate(source.shadows):
        for name, (model, needed_m) in robots.items():
            if model.base is None:
                continue  # it drives: no distance is fixed
            short_m = model.reach_m + needed_m + around_m - floor_distance(shadow, model.base)
            if short_m > 0:
                notes.append(
                    f"source.shadows.{i}: {short_m:.2f} m too close to robot {name} for it to "
                    f"continue at full speed after a person vanished there, until an Acknowledge"
                )
    return notes


def first_start_note(config: Config) -> list[str]:
    """Return a note that the next start needs an Acknowledge if there is no state file yet."""
    settings = config.node.state
    if settings is None or (path := config.base_dir / settings.path).exists():
        return []
    return [
        f"state: {path} does not exist yet, so the first start waits for one Acknowledge "
        f"(STATE_UNTRUSTED): make sure that no one is hidden in the room, then press once, "
        f"12 s or more after the start; if no controller can send an Acknowledge, leave state out"
    ]


def state_path(config: Config) -> str | None:
    """Path of the state file; ``None`` without one.

    Raises:
        ConfigError: the path is not a file.
    """
    settings = config.node.state
    if settings is None:
        return None
    path = config.base_dir / settings.path
    demand_state_file(path)
    return str(path)


def _listed(ends: list[str]) -> str:
    """Join words, such as "a, b or c"."""
    *first, last = ends
    return f"{', '.join(first)} or {last}" if first else last


def _unheard(config: Config) -> list[str]:
    """Return the names of robots that have only links that read."""
    advising = [link for link in config.links if link.advises]
    heard = {i for link in advising for i in advised(config, link)}
    return [robot.name for i, robot in enumerate(config.node.robots) if i not in heard]


# -- other settings --------------------------------------------------------------------------------


CHOOSING = ("modbus", "opcua")
"""Kinds of links by which a PLC chooses a configuration set."""


def general_notes(config: Config) -> list[str]:
    """Return notes on missing settings, and on settings more permissive than the defaults."""
    notes = []
    if not config.links:
        notes.append("no links: no controller receives the advice; add 'links:'")
    elif unheard := _unheard(config):
        notes.append(
            f"no link carries the advice to robot {', '.join(unheard)}: its links only read; add "
            f"one"
        )
    if any(link.simulate for link in config.links):
        notes.append("simulated links: mock controllers, no hardware")
    notes += [f"link {link.name}: {note}" for link in config.links for note in link.notes]
    notes += [f"source {config.source.kind}: {note}" for note in config.source.notes]
    if config.source.field_of_view is None:
        notes.append("no source.field_of_view: the whole room counts as seen")
    if (reason := config.node.people.posture_unchecked) is not None:
        notes.append(f"people.posture_unchecked: no check against gravity and the floor: {reason}")
    if config.node.risk.intrusion_m == 0:
        notes.append("risk.intrusion_m (C) is 0: valid only if the sensor sees even fingers")
    if margins := config.node.risk.region_margins_m:
        named = ", ".join(f"{region} {margin:g} m" for region, margin in margins.items())
        notes.append(f"risk.region_margins_m, beyond C + Z_d + Z_r: {named}")
    if config.node.risk.sets and not any(link.kind in CHOOSING for link in config.links):
        notes.append(
            "risk.sets: no link can choose a set, so every level stays unknown (SET_UNKNOWN); add a"
            f" link of kind {' or '.join(CHOOSING)}, or leave sets out"
        )
    if config.node.risk.latch and config.node.state is None:
        notes.append("risk.latch without 'state': latches are lost when the node restarts")
    if "restart" in config.node.risk.latch and config.node.state is None:
        notes.append("risk.latch restart needs 'state': without it no earlier run is known")
    if unused := unused_coverage(config):
        notes.append(unused)
    if (shown := config.node.foxglove) is not None and not is_loopback(shown.host):
        notes.append(
            f"foxglove.host {shown.host}: anyone who reaches port {shown.port} sees the people"
        )
    if config.node.robots and any(r.motion.kind == "standing" for r in config.node.robots):
        notes.append("a robot with motion 'standing' is assumed never to move")
    return notes


def gravity_note(config: Config, joint_map: JointMap) -> list[str]:
    """Return a note if the joint map cannot show which way is down, so wrong axes go undetected."""
    if config.node.people.posture_unchecked is not None or shows_down(joint_map.mapped):
        return []
    return [
        f"joint map {joint_map.name}: no check against gravity, which needs shoulders and hips, or "
        f"the head and the neck or shoulders. Only heights are checked: people.floor_m, platform_m"
    ]


def radius_note(risk: dict[str, Any]) -> list[str]:
    """Return a note for each circle that is too small even for a robot within its reach."""
    if risk["mode"] != "fixed":
        return []
    notes = []
    for name, needs in risk["robots"].items():
        least = needs["reach_m"] + sum(needs[term] for term in ("s_h", "c", "z_d", "z_r"))
        if needs["fixed_radius_m"] < least:
            notes.append(
                f"risk.fixed_radius_m {needs['fixed_radius_m']:g} is below the reach of robot"
                f" {name} + S_h + C + Z_d + Z_r, {least:.2f} m: the robot may touch a person who"
                " walks in before it has stopped"
            )
    return notes
