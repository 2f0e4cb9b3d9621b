"""The configuration that ``init`` writes, built from a few answers."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError, RobotError, nearest
from hri_predict.base.files import data_path
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.robots.model import RobotSettings, load_robot
from hri_predict.robots.trajectory import load_trajectory

PREDICTOR = "average"
"""The default, by the rule of docs/decisions/default-predictor.md."""
_HORIZON_S = 1.2  # as far as the shipped calibrations reach
_SHOWN = ("joint_map", "rate_hz", "host", "port", "baudrate", "min_latency_s", "interface",
          "channel", "bitrate")  # fmt: skip
"""Keys of sources and links written even with default values, because users look for them."""
_RATE_HZ = 30

DOORS_M = (3.0, 4.5, 7.0, 12.0)
"""Candidate distances of the door beyond the robot's reach; the first sufficient one is used."""
HINTS: dict[str, Any] = {
    "people": {"exits": [{"polygon": [[3.2, 2], [4.2, 2], [4.2, 3], [3.2, 3]]}]},
    "zones": [
        {
            "name": "hatch",
            "polygon": [[0.5, -1.5], [1.5, -1.5], [1.5, -0.8], [0.5, -0.8]],
            "level": "slow",
        }
    ],
    "state": "state.json",
}
"""Keys that most cells need, written as comments."""


@dataclass(kw_only=True)
class Answers:
    """Answers of the user.

    Attributes:
        robot: shipped name, or path of a robot file.
        max_speed_m_s: maximum speed of the robot's fastest point.
        source, links: blocks of the source and of the links.
        mode: mode of the risk stage.
        predictor: its name.
        simulated: without hardware: ``source`` and ``links`` are not used.
    """

    robot: str
    max_speed_m_s: float
    mode: str
    simulated: bool
    predictor: str = PREDICTOR
    source: dict[str, Any] = field(default_factory=dict)
    links: list[dict[str, Any]] = field(default_factory=list)


def _origin() -> dict[str, Any]:
    """Return a pose of its own, of which ``--set`` may change a number."""
    return {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}


def robot_block(model: str, max_speed_m_s: float, base_dir: Path) -> dict[str, Any]:
    """The robot's entry.

    Raises:
        ConfigError, RobotError: the robot does not exist, or the speed exceeds that of any robot.
    """
    block = {
        "name": "arm",
        "model": model,
        "room_from_robot": _origin(),
        "max_speed_m_s": _plain(max_speed_m_s),
        "motion": {"kind": "state"},
    }
    load_robot(validated(RobotSettings, block, "robot"), base_dir)
    return block


def source_block(kind: str) -> dict[str, Any]:
    """Return a source's entry with the keys that need no answer.

    Raises:
        ConfigError: the source does not exist.
    """
    model = registry.load("sources", kind).settings_model
    return {"kind": kind, "room_from_source": _origin()} | _shown(model, {"rate_hz": _RATE_HZ})


_FORMS = {
    "can": "can:INTERFACE:CHANNEL, such as can:socketcan:can0",
    "serial": "serial:PORT, such as serial:/dev/ttyUSB0",
}
"""Kinds of links that are written with the place of their device."""
_OWN_COLONS = ("/dev/serial/",)
"""Starts of ports whose names may have colons, as URLs have: the topology of USB."""
_DEVICES = {"can": "can", "vcan": "can", "slcan": "can", "tty": "serial", "/dev/": "serial"}
"""Start of a device's name, given instead of a link -> kind of the link."""


def _meant(text: str) -> str | None:
    """Return how the link is written for which a device, or a misspelt kind, was given."""
    device = next((kind for start, kind in _DEVICES.items() if text.startswith(start)), None)
    kind = device or next((each for each in _FORMS if f"'{each}'" in nearest(text, _FORMS)), None)
    return None if kind is None else _FORMS[kind]


def _is_rate(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 8 and int(text) >= 1200


def link_block(text: str, taken: list[str]) -> dict[str, Any]:
    """Return a link's entry from ``can:INTERFACE:CHANNEL``, ``serial:PORT`` or just a kind.

    Raises:
        ConfigError: the kind does not exist, or a part is missing.
    """
    kind, _, rest = text.partition(":")
    given: dict[str, Any] = {}
    if kind == "can":
        interface, colon, channel = rest.partition(":")
        if not (interface and colon and channel):
            raise ConfigError(f"write {_FORMS['can']}")
        if interface == "socketcan" and ":" in channel:
            raise ConfigError(
                f"write can:socketcan:{channel.partition(':')[0]}; `ip link` sets its bit rate"
            )
        given = {"interface": interface, "channel": channel}
    elif kind == "serial":
        if not rest:
            raise ConfigError(f"write {_FORMS['serial']}")
        port, colon, rate = rest.partition(":")
        if colon and "://" not in rest and not rest.startswith(_OWN_COLONS):
            key = f"links.{len(taken)}.baudrate={rate if _is_rate(rate) else 'RATE'}"
            raise ConfigError(f"write serial:{port or 'PORT'}, and for its baud rate --set {key}")
        given = {"port": rest}
    elif rest:
        raise ConfigError("write only the kind, and set its keys with --set links.0.KEY=VALUE")
    elif kind not in registry.names("links") and (ours := _meant(kind)) is not None:
        raise ConfigError(f"unknown link '{kind}'; write {ours}")
    model = registry.load("links", kind).settings_model
    number = len([name for name in taken if name.startswith(kind)])
    name = kind if number == 0 else f"{kind}{number + 1}"
    return {"name": name, "kind": kind} | given | _shown(model, {}, given) | _PROPOSED.get(kind, {})


_PROPOSED = {"serial": {"baudrate": 921_600}}
"""Better than the default: kind of link -> keys. 115200 bit/s, the default of the first release,
leaves no room for zones and poses; the USB adapters of today can do more.
"""


def _shown(model: Any, ours: dict[str, Any], given: dict[str, Any] | None = None) -> dict[str, Any]:
    found = {}
    for key in _SHOWN:
        if key in model.model_fields and key not in (given or {}):
            default = model.model_fields[key].get_default()
            value = ours.get(key, default) if model.model_fields[key].is_required() else default
            if isinstance(value, str | int | float):
                found[key] = _plain(value)
    return found


def _plain(value: str | float) -> str | float:
    """Return a whole number without decimals: 30 for 30.0."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def cell(answers: Answers, base_dir: Path, door_m: float) -> dict[str, Any]:
    """Return the configuration; ``door_m``: distance of the door beyond a simulated robot's reach.

    Raises:
        ConfigError, RobotError: the robot is wrong, or cannot be simulated.
    """
    robot = robot_block(answers.robot, answers.max_speed_m_s, base_dir)
    source, links = answers.source, answers.links
    data: dict[str, Any] = {"rate_hz": 25, "ticks": "capture", "max_rate_hz": 50}
    if answers.simulated:
        x, y = _door(robot, base_dir, door_m)
        source = source_block("procedural") | {"noise_m": 0.004, "people": [_visitor(x, y)]}
        links = _simulated_links(robot, base_dir)
    data["source"] = source
    if answers.simulated:
        corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
        exit_ = [[round(x + dx, 1), round(y + dy, 1)] for dx, dy in corners]
        data["people"] = {"exits": [{"polygon": exit_}]}
    data["predictor"] = {"name": answers.predictor, "horizon_s": _HORIZON_S}
    data["robots"] = [robot]
    data["risk"] = {
        "mode": answers.mode,
        "intrusion_m": 0,
        "person_uncertainty_m": 0.05,
        "latch": [],
    }
    if links:
        data["links"] = links
    data["alerts"] = {"file": "alerts.jsonl"}
    return data


_BEHIND_M = 1.1
"""Distance from the middle of the door to a visitor outside the room."""


def _door(robot: dict[str, Any], base_dir: Path, door_m: float) -> tuple[float, float]:
    """The middle of the door on the floor, m."""
    far = load_robot(validated(RobotSettings, robot, "robot"), base_dir).reach_m + door_m
    return round(0.8 * far, 1), round(0.6 * far, 1)


def _visitor(x: float, y: float) -> dict[str, Any]:
    """A person who enters, comes near and leaves again: the arm moves, stops and moves on."""
    behind = 1.0 + _BEHIND_M / math.hypot(x, y)
    return {
        "start": [x, y],
        "enter_s": 4,
        "script": [
            {"do": "walk", "to": [1.6, 0.1]},
            {"do": "wait", "seconds": 3},
            {"do": "walk", "to": [round(behind * x, 1), round(behind * y, 1)]},
            {"do": "leave", "seconds": 6},
        ],
    }


def hints(data: dict[str, Any]) -> dict[str, Any]:
    """Return the keys that the cell does not have yet."""
    return {key: value for key, value in HINTS.items() if key not in data}


def _simulated_links(robot: dict[str, Any], base_dir: Path) -> list[dict[str, Any]]:
    """A drive on a serial line, which moves the arm, and a monitor on a CAN bus."""
    drive = {"role": "drive", "robot": robot["name"], "trajectory": _trajectory(robot, base_dir)}
    monitor = {"role": "monitor", "robot": robot["name"]}
    return [
        {"name": "drive", "kind": "serial", "port": "simulated", "baudrate": 921_600,
         "simulate": drive},
        {"name": "monitor", "kind": "can", "interface": "slcan", "channel": "simulated",
         "bitrate": 500_000, "simulate": monitor},
    ]  # fmt: skip


def _trajectory(robot: dict[str, Any], base_dir: Path) -> str:
    """Return a shipped cycle that the robot can follow, preferably its own.

    Raises:
        RobotError: there is none.
    """
    model = load_robot(validated(RobotSettings, robot, "robot"), base_dir)
    own = [f"{robot['model']}_pick_and_place", "pick_and_place"]
    shipped = sorted(path.stem for path in data_path("trajectories").glob("*.yaml"))
    for name in (*(name for name in own if name in shipped), *shipped):
        try:
            load_trajectory(name, model, base_dir)
        except RobotError:
            continue
        return name
    raise RobotError(
        f"--simulated: no shipped trajectory fits robot {robot['model']}; leave --simulated out, or"
        f" name another robot"
    )
