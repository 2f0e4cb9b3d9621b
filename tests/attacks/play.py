"""Plays an attack: the whole node, the mock controllers and a referee on the virtual clock.

The attack gives the true bodies and what the tracker reports of them, both as functions of time.
"""

import contextlib
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level
from hri_predict.run import assemble, session
from hri_predict.run import config as configuration
from hri_sim.controllers.cell import MockCell
from hri_sim.referee import Referee

RATE_HZ = 30.0
NEAR_M = 0.3
"""*Clear* is wrong while a body is nearer than this to a robot that moves."""
ALL: Bools = np.ones(len(JOINTS), dtype=bool)
EXIT = [[3.2, 2.0], [4.2, 2.0], [4.2, 3.0], [3.2, 3.0]]
CELL = yaml.safe_load(f"""
rate_hz: 25
source: {{kind: procedural, room_from_source: {{xyz: [0, 0, 0]}}, rate_hz: {RATE_HZ},
  noise_m: 0.004, keeps_ids: false, people: []}}
people: {{exits: [{{polygon: {EXIT}}}]}}
predictor: {{name: constant_velocity, horizon_s: 1.2}}
robots:
  - {{name: arm, model: ur5e, room_from_robot: {{xyz: [0, 0, 0]}}, payload_kg: 2.0,
      max_speed_m_s: 1.0, motion: {{kind: state, stale_s: 0.1}}}}
risk: {{mode: predictive, person_uncertainty_m: 0.05}}
alerts: {{terminal: false}}
links:
  - {{name: drive, kind: serial, port: simulated, baudrate: 921600, zones: false,
      simulate: {{role: drive, robot: arm, trajectory: pick_and_place, max_age_s: 0.2}}}}
  - {{name: monitor, kind: can, interface: slcan, channel: simulated, bitrate: 500000,
      zones: false, simulate: {{role: monitor, robot: arm, max_age_s: 0.2}}}}
""")

Reported = tuple[int, Floats] | tuple[int, Floats, Bools]
"""An id, its (21, 3) joints in metres, and which of them are observed; default: all."""


@dataclass(frozen=True, kw_only=True)
class Attack:
    """One drawn attack.

    Attributes:
        name: its kind and its parameters.
        truth: time in seconds -> (21, 3) joints of every person in the room.
        seen: time and number of the capture -> what the tracker reports.
        seconds: length of the story.
        noise_m: standard deviation of the noise on each observed coordinate.
        declares_noise: what the source says about its noise.
        origin: the source's origin in the room, metres.
        change: changes the configuration.
        cell: changes the simulated cell before its first step.
        step: called after each step of the cell, with the time in seconds.
        before: runs before this attack with the same state file, and then changes the file.
        moving: from and until when the robot must be permitted to move, s: a cell that stands for
            ever harms nobody.
        near_m: *clear* at a smaller distance counts as wrong; 0 where it cannot be avoided.
    """

    name: str
    truth: Callable[[float], Sequence[Floats]]
    seen: Callable[[float, int], Sequence[Reported]]
    seconds: float
    noise_m: float = 0.004
    declares_noise: bool = True
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    change: Callable[[dict[str, Any]], None] | None = None
    cell: Callable[[MockCell], None] | None = None
    step: Callable[[MockCell, float], None] | None = None
    before: "tuple[Attack, Callable[[Path], None]] | None" = None
    near_m: float = NEAR_M
    moving: tuple[float, float] | None = None


@dataclass(kw_only=True)
class Outcome:
    """What came of an attack in one mode.

    Attributes:
        contacts: touches of a moving robot.
        clear_near: ticks of *clear* while a body was nearer than ``Attack.near_m`` to it.
        stood: whether no motion was permitted when it must be, see ``Attack.moving``.
        levels: seconds after the start -> level and reason, at each change.
    """

    contacts: int = 0
    clear_near: int = 0
    stood: bool = False
    levels: list[tuple[float, str, str]] = field(default_factory=list)

    @property
    def fine(self) -> bool:
        """Whether nobody was touched, no *clear* came beside a person, and the cell is usable."""
        return not self.contacts and not self.clear_near and not self.stood


class Staged:
    """A source of an attack's scenes; see ``hri_predict.contracts.source.Source``."""

    def __init__(self, attack: Attack) -> None:
        self.joint_map = load_joint_map("canonical")
        self.rate_hz = RATE_HZ
        self.declares_noise = attack.declares_noise
        self._attack = attack
        self._rng = np.random.default_rng(0)
        self._start_ns = self._next = 0

    def open(self, start_ns: int) -> None:
        """Start: the first capture is at ``start_ns``."""
        self._start_ns, self._next = start_ns, 0

    def next_ns(self) -> int:
        """Arrival of the next scene."""
        return self._start_ns + round(self._next / RATE_HZ * 1e9)

    def poll(self, now_ns: int) -> Scene | None:
        """Return the next scene if it has arrived."""
        due_ns = self.next_ns()
        if due_ns > now_ns:
            return None
        number = self._next
        self._next += 1
        reported = self._attack.seen(number / RATE_HZ, number)
        return Scene(due_ns, number, True, tuple(map(self._person, reported)))

    def _person(self, reported: Reported) -> Person:
        number, joints = reported[:2]
        observed = reported[2] if len(reported) > 2 else ALL
        zero = (joints == self._attack.origin).all(axis=-1)  # exactly there, without noise
        noise = self._rng.normal(0.0, self._attack.noise_m, joints.shape)
        noisy = joints + np.where(zero[:, None], 0.0, noise)
        return Person(number, np.where(observed[:, None], noisy, np.nan), observed)

    def truth(self, now_ns: int) -> dict[int, tuple[Floats, Bools]]:
        """Return the true people: number -> joints and which are known."""
        t = (now_ns - self._start_ns) * 1e-9
        return {i: (joints, ALL) for i, joints in enumerate(self._attack.truth(t))}

    def close(self) -> None:
        """Do nothing."""


class _Watch(session.View):
    """Each tick's advice, against the true distance."""

    def __init__(self, outcome: Outcome, attack: Attack) -> None:
        self.outcome, self._attack = outcome, attack
        self.outcome.stood = attack.moving is not None
        self.assembly: assemble.Assembly | None = None
        self._truth = Staged(attack)
        self._truth.open(session.VIRTUAL_START_NS)
        self.stepped: tuple[MockCell, int] | None = None  # the cell, and when it last moved

    def bind(self, assembly: assemble.Assembly) -> None:
        self.assembly = assembly

    def on_tick(self, tick: Tick) -> None:
        t = (tick.now_ns - session.VIRTUAL_START_NS) * 1e-9
        advice = tick.advices[0]
        if advice.level is Level.CLEAR and self._distance_m() < self._attack.near_m:
            self.outcome.clear_near += 1
        since_s, until_s = self._attack.moving or (0.0, 0.0)
        if since_s <= t < until_s and (advice.speed_limit_m_s or 0.0) > 0.3:
            self.outcome.stood = False
        now = (advice.level.name, advice.reason.name)
        if not self.outcome.levels or self.outcome.levels[-1][1:] != now:
            self.outcome.levels.append((round(t, 2), *now))

    def _distance_m(self) -> float:
        """The true distance of the nearest body, when the cell last moved."""
        if self.assembly is None or self.stepped is None:
            return np.inf
        cell, at_ns = self.stepped
        referee = Referee(self.assembly.robots, tool_of=cell.tool_of)
        referee.observe(at_ns, self._truth.truth(at_ns), cell.robot_truth(at_ns))
        known = referee.min_separation_m
        return np.inf if known is None else known


def play(attack: Attack, mode: str) -> Outcome:
    """Play an attack in one risk mode."""
    with tempfile.TemporaryDirectory(prefix="attack-") as folder:
        state = None if attack.before is None else Path(folder) / "state.json"
        return _after_all(attack, mode, Path(folder), state)


def _after_all(attack: Attack, mode: str, folder: Path, state: Path | None) -> Outcome:
    """Play what comes before the attack, then the attack; all with the same state file."""
    if attack.before is not None:
        earlier, spoil = attack.before
        _after_all(earlier, mode, folder, state)
        spoil(folder)
    return _run(attack, mode, folder, state)


def _run(attack: Attack, mode: str, folder: Path, state: Path | None) -> Outcome:
    data: dict[str, Any] = yaml.safe_load(yaml.safe_dump(CELL))  # a copy of its own
    data["risk"]["mode"] = mode
    if attack.change is not None:
        attack.change(data)
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    outcome = Outcome()
    watch = _Watch(outcome, attack)
    with _staged(attack, watch):
        summary = session.run(
            configuration.load(path),
            session.Options(factor=None, duration_s=attack.seconds, view=watch, state=state),
        )
    outcome.contacts = summary.contacts or 0
    return outcome


@contextlib.contextmanager
def _staged(attack: Attack, watch: _Watch) -> Iterator[None]:
    """The attack's source in place of the configured one, and eyes and hands in the cell."""
    step, transports = MockCell.step, MockCell.transports

    def connected(cell: MockCell) -> Mapping[str, Any]:
        ends = transports(cell)
        if attack.cell is not None:
            attack.cell(cell)
        return ends

    def stepped(cell: MockCell, now_ns: int) -> None:
        step(cell, now_ns)
        if attack.step is not None:
            attack.step(cell, (now_ns - session.VIRTUAL_START_NS) * 1e-9)
        watch.stepped = (cell, now_ns)

    with (
        patch.object(assemble, "build_source", lambda config, with_faults=True: Staged(attack)),
        patch.object(MockCell, "step", stepped),
        patch.object(MockCell, "transports", connected),
    ):
        yield
