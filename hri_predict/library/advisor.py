"""The node's complete processing as a function call: scenes and robot states in, zones and advice
out.
"""

import operator
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import MAX_RATE_HZ, MIN_RATE_HZ
from hri_predict.contracts.joint_map import JointMap, load_joint_map
from hri_predict.contracts.link import LinkCounters, Received
from hri_predict.contracts.scene import Scene
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Acknowledge, Message, RobotState
from hri_predict.run import assemble
from hri_predict.run.config import Config, load


def load_config(path: str | Path) -> Config:
    """Read and validate a configuration: a file, or the name of a shipped one (``demo.yaml``).

    Raises:
        ConfigError: one line naming the file, the key and the remedy.
    """
    return load(Path(path))


RUN = 30
"""Number of scenes over which the unit of the caller's clock is checked."""
TOO_FAST = 300
"""A clock on which scenes come this many times as fast as ``rate_hz`` does not count nanoseconds;
one that counts microseconds is 1000 times too slow. No backlog of scenes is processed as fast."""


class Advisor:
    """A node without its own source, links or clock: the caller replaces all three.

    Everything between is the node's: people, predictor, zones, levels with their memory. So the
    levels depend on earlier calls: pass every scene, in order, and keep one advisor per cell. The
    configuration's ``source`` still defines the maximum age of input and the sensor's view
    (``min_latency_s``, ``stale_s``, ``field_of_view``); its ``links`` are still part of the delay
    budget; nothing is opened. For one thread.

    Args:
        config: see ``load_config``.
        joint_map: names of the joints in the scenes; by default the canonical ones, see
            ``CANONICAL.joints``. The scenes' positions are metres in the room whatever the map's
            units and axes are.
        rate_hz: nominal scenes per second; by default the configuration's ``rate_hz``.
        start_ns: time on the caller's clock, whole nanoseconds, at which robots start a planned
            trajectory.

    Attributes:
        robots: names of the robots, in the order of their indices.
        segments: names of the body segments, indexed by ``Advice.body_part``.

    Raises:
        HriPredictError: a part cannot be built; one line with the remedy.
    """

    def __init__(
        self,
        config: Config,
        *,
        joint_map: JointMap | None = None,
        rate_hz: float | None = None,
        start_ns: int = 0,
    ) -> None:
        source = _Caller(
            load_joint_map("canonical") if joint_map is None else joint_map,
            config.node.rate_hz if rate_hz is None else rate_hz,
        )
        self._inbox = _Inbox()
        self._now_ns: int | None = None
        self._least_ns = round(RUN * 1e9 / source.rate_hz / TOO_FAST)
        self._scenes_ns: deque[int] = deque(maxlen=RUN + 1)
        assembly = assemble.build(
            config,
            VirtualClock(_whole("start_ns", start_ns)),
            source=source,
            links=[self._inbox],
            deadline=False,
        )
        self._node = assembly.node
        self.robots = tuple(robot.name for robot in config.node.robots)
        self.segments = assembly.prediction.predictor.skeleton.segment_names

    def advise(
        self,
        scene: Scene | None,
        received: Sequence[RobotState | Acknowledge] = (),
        *,
        now_ns: int,
    ) -> Tick:
        """Run one tick.

        Args:
            scene: observed people, metres in the room's frame; ``None`` without a new scene, so
                that the input ages.
            received: messages of the controllers since the last call: each robot's joint state
                (rad, rad/s), with a counter that advances, and acknowledgements.
            now_ns: the caller's monotonic clock at this call, whole nanoseconds, later than at the
                last one: ``time.monotonic_ns()``. It determines the age of the input. In a live
                cell never pass the scene's own ``stamp_ns``: every scene would appear fresh,
                however late. For a recording that is correct.

        Returns:
            ``advices`` has one Advice per robot; ``assessment.zones`` contains the zone of every
            body segment at each time. If the tick failed, ``assessment`` is ``None`` and every
            advice is *fault*.

        Raises:
            ConfigError: ``now_ns`` does not advance, is not an integer, or advances as if it were
                not in nanoseconds; input would never become stale.
        """
        now_ns = _whole("now_ns", now_ns)
        if self._now_ns is not None and now_ns <= self._now_ns:
            raise ConfigError(
                f"advise: now_ns {now_ns} is not later than at the last call ({self._now_ns}); "
                f"give a monotonic clock"
            )
        self._now_ns = now_ns
        if scene is not None:
            self._check_unit(now_ns)
            self._node.receive(scene, now_ns)
        self._inbox.waiting.extend(Received(message, now_ns) for message in received)
        return self._node.tick(now_ns)

    def _check_unit(self, now_ns: int) -> None:
        """Refuse a clock that counts milliseconds, say: a second of silence would be 1 µs."""
        self._scenes_ns.append(now_ns)
        elapsed_ns = now_ns - self._scenes_ns[0]
        if len(self._scenes_ns) > RUN and elapsed_ns < self._least_ns:
            raise ConfigError(
                f"advise: now_ns is in nanoseconds, but advanced by only {elapsed_ns} over {RUN} "
                "scenes; give time.monotonic_ns(), or correct rate_hz"
            )


def _whole(name: str, value: Any) -> int:
    try:
        return operator.index(value)
    except TypeError:
        raise ConfigError(
            f"{name} {value!r}: must be a whole number of nanoseconds, such as time.monotonic_ns()"
        ) from None


class _Caller:
    """A source (see ``hri_predict.contracts.source.Source``) with scenes provided by the caller."""

    declares_noise = False

    def __init__(self, joint_map: JointMap, rate_hz: float) -> None:
        if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
            raise ConfigError(
                f"rate_hz {rate_hz:g}: must be {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} scenes per second"
            )
        self.joint_map, self.rate_hz = joint_map, rate_hz

    def open(self, start_ns: int) -> None:
        """There is nothing to open."""

    def next_ns(self) -> int | None:
        """Return ``None``: scenes come only from the caller."""
        return None

    def poll(self, now_ns: int) -> Scene | None:
        """Return ``None``: there is no further scene."""
        return None

    def close(self) -> None:
        """There is nothing to close."""


class _Inbox:
    """A link (see ``hri_predict.contracts.link.Link``) that receives from the caller and does not
    send.
    """

    name = "caller"

    def __init__(self) -> None:
        self.counters = LinkCounters()
        self.connected = True
        self.last_error: str | None = None
        self.foreign_ns: int | None = None
        self.on_sent: Callable[[str, bytes, int], None] | None = None
        self.waiting: deque[Received] = deque()

    def start(self) -> None:
        """There is nothing to open."""

    def post(self, message: Message) -> None:
        """Do nothing: the caller gets every message in the tick."""

    def take(self) -> list[Received]:
        """Return the caller's messages."""
        taken = list(self.waiting)
        self.waiting.clear()
        return taken

    def service(self, now_ns: int) -> None:
        """Do nothing: there is no data to write or read."""

    def stop(self) -> None:
        """There is nothing to close."""
