"""Notes of ``check`` on how lost people end, and on shadows that keep a robot waiting."""

from collections.abc import Mapping

from hri_predict.node.memory import demand_state_file
from hri_predict.people.lost.free_space import BODY_M, CELL_M
from hri_predict.risk.areas import floor_distance
from hri_predict.robots.model import RobotModel
from hri_predict.run.config import Config
from hri_predict.zones.lost_places import ARM_M

PAGE = "docs/guides/lost-people.md"


def lost_notes(
    config: Config, robots: Mapping[str, tuple[RobotModel, float]], rate_hz: float
) -> list[str]:
    """Return notes for the person who wires the cell, one line each.

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
            f"who vanishes for longer than {found} stays lost until {_listed(ends)} ends it; "
            f"see {PAGE}"
        ]
    notes = []
    if not source.viewpoints:
        notes.append(
            "source.sees_free_space without viewpoints: nothing counts as seen free while a "
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
                    f"source.shadows.{i}: {short_m:.2f} m too close to robot {name} for it to go "
                    f"on at full speed after a person vanished there, until an Acknowledge"
                )
    return notes


def first_start_note(config: Config) -> list[str]:
    """A line that the next start needs an Acknowledge, because there is no state file yet."""
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
        ConfigError: something else is there.
    """
    settings = config.node.state
    if settings is None:
        return None
    path = config.base_dir / settings.path
    demand_state_file(path)
    return str(path)


def _listed(ends: list[str]) -> str:
    """Such as "a, b or c"."""
    *first, last = ends
    return f"{', '.join(first)} or {last}" if first else last
