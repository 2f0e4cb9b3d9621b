"""Full speed of each robot, and the distances from people that are enough for it and to start."""

import yaml

from hri_predict.base.files import load_yaml
from hri_predict.explaining.deciding import milder_slack_of, needed_by
from hri_predict.explaining.situation import Situation
from hri_predict.explaining.values import listed, mapped, number, text, whole
from hri_predict.recording import RecordingInfo, Told
from hri_predict.recording.mcap.info import FullSpeed


def is_full(limit_m_s: float | None, full_m_s: float | None) -> bool:
    """Whether a speed limit restricts nothing; an unknown full speed counts as a restriction."""
    return limit_m_s is not None and full_m_s is not None and limit_m_s >= full_m_s


def full_speeds(info: RecordingInfo) -> dict[str, float]:
    """``max_speed_m_s`` (m/s) of each robot that the recorded configuration names."""
    try:
        data = mapped(load_yaml(info.config))
    except (yaml.YAMLError, ValueError, RecursionError):
        return {}
    found = {}
    for robot in map(mapped, listed(data.get("robots"))):
        full = number(robot.get("max_speed_m_s"))
        if full is not None and full > 0:
            found[text(robot.get("name"))] = full
    return found


def full_speed(about: Situation) -> float | None:
    """Return the robot's full speed, m/s; ``None``: the recording does not state it."""
    return full_speeds(about.info).get(about.robot)


def enough_m(about: Situation) -> float | None:
    """Return the distance from people that is enough for full speed by the standard.

    ``None``: the recording does not state it, the standard does not cover the deciding person, the
    robot was measured to stop later than the table from which it follows, or it needed more even as
    it moved.
    """
    stated = _stated(about)
    if stated is None:
        return None
    enough, needed = stated.enough_m + _more_z_r_m(about, stated), needed_by(about.advice)
    if milder_slack_of(about.advice) is None and needed is not None and needed > enough:
        return None  # the person moved otherwise than the standard assumes: only zones counted
    return enough


def start_m(about: Situation) -> float | None:
    """Return the distance from people at which a robot that may not move may start, or move on.

    By the standard, as for ``enough_m``, and ``None`` in the same cases.
    """
    stated = _stated(about)
    if stated is None or stated.start_m is None or enough_m(about) is None:
        return None
    return stated.start_m + _more_z_r_m(about, stated)


def _stated(about: Situation) -> FullSpeed | None:
    """Return the distances that the recording states, if they apply to the deciding person."""
    stops_late = any(map(_stops_late, about.window.node))
    return about.info.full_speed.get(about.robot) if _as_assumed(about) and not stops_late else None


def _more_z_r_m(about: Situation, stated: FullSpeed) -> float:
    """Return by how much the robot's position was less certain than stated."""
    terms = mapped(mapped(about.advice.data.get("grounds")).get("terms_m"))
    return max(0.0, (number(terms.get("z_r")) or 0.0) - stated.z_r_m)


def _as_assumed(about: Situation) -> bool:
    """Whether the deciding person was tracked, at a known speed that the standard assumes."""
    grounds = mapped(about.advice.data.get("grounds"))
    person, human_m_s = whole(grounds.get("person")), number(grounds.get("human_m_s"))
    seen = next((each for each in about.people if each["id"] == person), None)
    return seen is not None and seen["state"] == "tracked" and not seen["speed"] and not human_m_s


def _stops_late(node: Told) -> bool:
    return bool(whole(mapped(node.data.get("node")).get("robot_stops_late")))
