"""Ways to reduce each term of the working distance in the cell as it is configured."""

from collections.abc import Callable, Sequence

from hri_predict.base.skeleton import in_words
from hri_predict.run.config import Config

BEST = "average"
"""The shipped predictor with the smallest working distances (docs/guides/simulate.md)."""


def remedy(key: str, config: Config, lacking: Sequence[str], hidden: Sequence[str] = ()) -> str:
    """Return how to reduce a term.

    Args:
        key: see ``waterfall.Term``.
        config: the cell.
        lacking: joints that its joint map does not deliver.
        hidden: other joints that the camera does not see.
    """
    if key == "unseen":
        return _unseen(lacking, hidden)
    found = _OF_THE_CELL.get(key)
    return _ALWAYS[key] if found is None else found(config)


_ALWAYS = {
    "silence_timeout": "lower links.silence_timeout_s as far as the controller and this machine "
    "allow; a note appears when it is too short",
    "reaction": "measure it (hri-predict commission) and set links.reaction_s",
    "link_delay": "use a faster link (links.delay_s)",
    "cycle": "raise rate_hz, if this machine keeps up",
    "place": "use a depth camera, or two cameras",
    "release": "lower risk.release_captures, raise risk.speed_rise_m_s2",
    "robot_state": "send RobotState more often, and measure motion.acceleration_m_s2",
}


def _age(config: Config) -> str:
    faster = "use a source with more scenes per second or less delay"
    return faster if config.node.ticks == "capture" else f"set ticks: capture, and {faster}"


def _stopping(config: Config) -> str:
    unstated = any(robot.payload_kg is None for robot in config.node.robots)
    load = "state the true payload_kg (the highest is assumed), " if unstated else ""
    return (
        f"{load}measure the stopping table, or let the robot move more slowly: a plan whose "
        "points take longer, then a lower max_speed_m_s"
    )


def _unseen(lacking: Sequence[str], hidden: Sequence[str]) -> str:
    ways = []
    if hidden:
        ways.append(f"move or add a camera so that it sees {_listed(hidden)}")
    if lacking:
        ways.append(f"use a tracker that also delivers {_listed(lacking)}")
    if not ways:
        return "observe more of the body: add a camera"
    return f"{', and '.join(ways)} (simulate --distance --tracker full measures what that saves)"


def _listed(joints: Sequence[str]) -> str:
    return ", ".join(map(in_words, joints))


def _seen(config: Config) -> str:
    site = "calibrate for this site (hri-predict calibrate --onto shipped)"
    return site if config.predictor.name == BEST else f"use predictor {BEST}, or {site}"


def _margins(config: Config) -> str:
    risk = config.node.risk
    slow_m = 0.0 if risk.mode == "fixed" else risk.slow_margin_m  # the circle has no such margin
    remedies = ["measure the errors that the other margins stand for"]
    if slow_m:
        remedies.insert(
            0,
            f"lower slow_margin_m from {slow_m:g}: the robot slows down later, S_p stays (listed "
            "as less safe, because people then meet a faster robot)",
        )
    return ", and ".join(remedies)


_OF_THE_CELL: dict[str, Callable[[Config], str]] = {
    "age": _age,
    "stopping": _stopping,
    "seen": _seen,
    "margins": _margins,
}
