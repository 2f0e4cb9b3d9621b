"""Full speed of each robot, the reference for speed limits."""

import yaml

from hri_predict.base.files import load_yaml
from hri_predict.explaining.values import listed, mapped, number, text
from hri_predict.recording import RecordingInfo


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
