"""RobotState from ``sensor_msgs/JointState``: maps names to joints, and detects new states.

A JointState has neither mode, counter nor request. A state counts as new if its stamp advances, and
if by this machine's UTC it is no older than the robot's ``motion.delay_s``: the state of a
publisher that hangs, repeats or uses another clock ages as if the publisher were silent. Without
``automatic`` the robot's mode is unknown, and so is its advice.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Self

from pydantic import Field, model_validator

from hri_drivers.wires.ros2_heard import SEVERAL_GIDS, Heard
from hri_drivers.wires.ros2_publishers import Publishers
from hri_drivers.wires.ros2_settings import TopicName
from hri_predict.base.errors import first_line
from hri_predict.base.quantities.safe_side import LessSafe, Safety
from hri_predict.base.settings import Settings
from hri_predict.protocol.messages import RobotMode, RobotState
from hri_predict.protocol.reception import ReceiveCounters
from hri_predict.protocol.ros.messages import typestore
from hri_predict.protocol.ros.stamps import stamp_ns

JOINT_STATE = "sensor_msgs/msg/JointState"
COUNTERS = 1 << 16
MAX_BYTES = 1 << 16
AHEAD_NS = 5_000_000
"""Maximum lead of a stamp over this machine's UTC: the clocks of one machine, read in turn."""


class JointStatesSettings(Settings):
    """``joint_states:`` of a ``ros2`` link."""

    topic: TopicName = Field("/joint_states", description="topic of sensor_msgs/JointState")
    names: list[str] = Field(
        min_length=1,
        max_length=32,
        description="names of the robot's joints in JointState, in the order of its model",
    )
    automatic: bool = Field(
        False,
        description="assume automatic mode, because JointState has no operating mode; without "
        "this the advice is unknown",
    )

    safety: ClassVar[Safety] = {
        "automatic": LessSafe(
            other="the robot counts as in automatic mode whatever its controller's mode is"
        ),
    }

    @model_validator(mode="after")
    def _once(self) -> Self:
        if len(set(self.names)) < len(self.names):
            raise ValueError("names: a joint is named twice; name each once")
        return self


class JointStateReader:
    """Makes RobotStates of one robot from its JointStates.

    A repeated stamp repeats the counter, so that the node detects a publisher that hangs.

    Args:
        settings: names and mode.
        delay_s: maximum age of a state at its arrival.
        counters: counts received and refused messages.
        utc_ns, monotonic_ns: this machine's clocks, ns.

    Attributes:
        robot: index of the robot.
        refused: why the last refused message was refused; "" if none was.
    """

    def __init__(
        self,
        settings: JointStatesSettings,
        delay_s: float,
        counters: ReceiveCounters,
        *,
        utc_ns: Callable[[], int] = time.time_ns,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.robot = 0
        self.refused = ""
        self._settings = settings
        self._delay_ns = round(delay_s * 1e9)
        self._counters = counters
        self._utc_ns = utc_ns
        self._monotonic_ns = monotonic_ns
        self._store = typestore("jazzy")
        self._publishers = Publishers()
        self._counter = 0
        self._stamp_ns = 0

    def read(self, data: bytes) -> RobotState | None:
        """The state in a unit of ``Heard``; ``None`` if there is none (counted)."""
        try:
            state = self._state(Heard.of(data))
        except Exception as error:  # of any kind, on damaged bytes
            self.refused = first_line(error)[:300]
            self._counters.malformed += 1
            return None
        self._counters.received += state is not None
        return state

    def _state(self, heard: Heard) -> RobotState | None:
        """The state; ``None`` for a message about other joints.

        Raises:
            ValueError: it cannot be used; one line with the remedy.
        """
        topic = self._settings.topic
        if len(heard.content) > MAX_BYTES:
            raise ValueError(f"{topic}: a message of more than {MAX_BYTES} bytes")
        message = self._message(heard.content)
        places = {name: k for k, name in enumerate(message.name)}
        missing = [name for name in self._settings.names if name not in places]
        if len(missing) == len(self._settings.names) and self._counter:
            self._counters.ignored += 1  # of a gripper, say
            return None
        if missing:
            raise ValueError(f"{topic}: no joint '{missing[0]}'; correct 'joint_states.names'")
        if twice := [n for n in self._settings.names if list(message.name).count(n) > 1]:
            raise ValueError(f"{topic}: names joint '{twice[0]}' twice; correct the publisher")
        if self._publishers.contradicted(heard, self._monotonic_ns()):
            if heard.gid == SEVERAL_GIDS:
                raise ValueError(
                    f"{topic}: several publishers, and this release of ROS does not report which "
                    f"of them sent a message; give each its own topic"
                )
            raise ValueError(f"{topic}: two publishers of these joints; stop one of them")
        self._count(stamp_ns(message.header.stamp))
        order = [places[name] for name in self._settings.names]
        return RobotState(
            robot=self.robot,
            mode=RobotMode.AUTOMATIC if self._settings.automatic else RobotMode.UNKNOWN,
            counter=self._counter,
            positions=_picked(f"{topic}: position", message.position, message.name, order),
            velocities=_picked(f"{topic}: velocity", message.velocity, message.name, order),
        )

    def _message(self, content: bytes) -> Any:
        try:
            return self._store.deserialize_cdr(content, JOINT_STATE)
        except Exception as error:  # rosbags raises many kinds on damaged bytes
            raise ValueError(f"{self._settings.topic}: not a {JOINT_STATE}") from error

    def _count(self, at_ns: int) -> None:
        """Advance the counter if the stamp advances.

        Raises:
            ValueError: the stamp is earlier than the previous one, older than the delay, or from
                another clock.
        """
        topic, age_ns = self._settings.topic, self._utc_ns() - at_ns
        if not -AHEAD_NS <= age_ns <= self._delay_ns:
            raise ValueError(
                f"{topic}: a stamp {age_ns * 1e-9:.3g} s before this machine's UTC, and "
                f"motion.delay_s {self._delay_ns * 1e-9:g}: delayed, or stamped with another clock"
            )
        if self._stamp_ns > at_ns + age_ns + AHEAD_NS:
            self._stamp_ns = 0  # both clocks were set back
        if at_ns < self._stamp_ns:
            raise ValueError(f"{topic}: a stamp earlier than the previous one")
        if at_ns > self._stamp_ns:
            self._stamp_ns = at_ns
            self._counter = (self._counter + 1) % COUNTERS


def _picked(
    what: str, values: Sequence[float], names: Sequence[str], order: Sequence[int]
) -> tuple[float, ...]:
    if len(values) != len(names):
        raise ValueError(
            f"{what} has {len(values)} values for {len(names)} names; let the publisher "
            f"send both position and velocity"
        )
    return tuple(float(values[k]) for k in order)
