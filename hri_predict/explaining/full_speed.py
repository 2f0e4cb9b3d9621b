"""Full speed of each robot, from the configuration in the recording."""

import yaml

from hri_predict.base.files import load_yaml
from hri_predict.explaining.values import listed, mapped, number, text
from hri_predict.recording import RecordingInfo


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
