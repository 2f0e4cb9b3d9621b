"""Common part of links that poll a robot's state; a protocol provides its transport and settings.

The link sends nothing: the robot receives the advice on another link.
"""

import math
import struct
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, TypeVar

from hri_drivers.links.configured import ConfiguredLink
from hri_drivers.links.load import Traffic
from hri_drivers.links.polled.reader import LONGEST_STEP_S, Sample, StateReader
from hri_drivers.links.polled.settings import PolledLinkSettings, StateAt
from hri_drivers.wires.transport import Transport
from hri_predict.base.errors import LinkError
from hri_predict.contracts.link import LinkCounters
from hri_predict.protocol.messages import Advice, Message, RobotState, Status
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.reception import ReceiveCounters
from hri_predict.robots.settings import RobotSettings, StateMotion

BITRATE = 10_000_000
OVERHEAD_BYTES = 300
"""Maximum bytes of Ethernet, IPv6, TCP and the protocol around a request and its reply."""
VALUE_BYTES = 80
"""Maximum bytes of one value and of its address in the request."""


def reading_s(values: int) -> float:
    """Seconds on the network of one reading of ``values`` numbers."""
    return 8 * (OVERHEAD_BYTES + VALUE_BYTES * values) / BITRATE


class PolledCodec:
    """Readings as RobotStates; see ``hri_drivers.links.codec.Codec``.

    Args:
        reader: makes the states.
        counters: see ``contracts.link.Receiver``; shared with the reader.

    Attributes:
        reader, counters: as given.
    """

    def __init__(self, reader: StateReader, counters: ReceiveCounters) -> None:
        self.reader, self.counters = reader, counters

    @property
    def refused(self) -> str:
        """The reason for the last refusal of a reading."""
        return self.reader.refused

    def carries(self, message: Message) -> bool:
        """Nothing."""
        return False

    def watch(self, own: OwnFrames) -> None:
        """Do nothing: this node sends no frames that could return."""

    def encode(self, message: Message) -> list[Sample]:
        """Nothing."""
        return []

    def decode(self, unit: Sample) -> list[Message]:
        """Return the state in the reading, if any."""
        state = self.reader.read(unit)
        return [] if state is None else [state]

    feed = decode
    """See ``contracts.link.Receiver``."""

    def reset(self) -> None:
        """Discard the state of the previous connection."""
        self.reader.restart()

    def count(self, counters: LinkCounters) -> None:
        """Copy the counts of refused readings."""
        counters.malformed = self.counters.malformed
        counters.incomplete = self.counters.incomplete

    def worst_s(self, message: Message) -> float:
        """0: nothing is sent."""
        return 0.0

    def unit_s(self, unit: Sample) -> float:
        """Seconds on the network of one reading."""
        return reading_s(len(unit.values))

    def raw(self, unit: Sample) -> bytes:
        """The values as doubles; NaN for values that are not numbers."""
        values = [float("nan") if each is None else float(each) for each in unit.values]
        return struct.pack(f">{len(values)}d", *values)

    def size(self, unit: Sample) -> int:
        """Number of bytes of the values as doubles."""
        return 8 * len(unit.values)


P = TypeVar("P", bound=PolledLinkSettings)


class PolledLink(ConfiguredLink[P, Sample], ABC):
    """``contracts.link.Link`` that reads; arguments as for ``ConfiguredLink``."""

    unprotected: ClassVar[str]

    def _prepare(self, settings: P, robots: Sequence[int]) -> None:
        assert isinstance(self._codec, PolledCodec)
        self._codec.reader.robot = robots[0]

    @staticmethod
    @abstractmethod
    def _state(settings: P) -> StateAt[Any]:
        """Return the name and address of all values to read."""

    @classmethod
    def _make_codec(cls, settings: P, wire: Transport[Sample]) -> PolledCodec:
        if settings.max_state_age_s is None:
            raise LinkError(f"link '{settings.name}': max_state_age_s is missing; set it")
        return cls.receiver(settings)

    @classmethod
    def receiver(cls, settings: P) -> PolledCodec:
        """Return a decoder of readings, for listeners."""
        counters = ReceiveCounters()
        age_s = settings.max_state_age_s or 1.0
        state = cls._state(settings)
        reader = StateReader(state, age_s, settings.controller_delay_s, counters)
        return PolledCodec(reader, counters)

    @classmethod
    def of_robots(cls, settings: P, robots: Sequence[RobotSettings]) -> P:
        """Return the settings with the age of the robot's states; see ``contracts.OfRobots``.

        Raises:
            LinkError: several robots; or their states' age is not known, above the robot's, or
                below the delay of reading at this rate.
        """
        named = f"link '{settings.name}'"
        if len(robots) != 1:
            raise LinkError(
                f"{named}: it reads the state of one robot, and has {len(robots)}; name one under "
                f"'robots', and use a separate link for each"
            )
        motion = robots[0].motion
        delay_s = motion.delay_s if isinstance(motion, StateMotion) else 0.0
        age_s = settings.max_state_age_s or delay_s
        if not isinstance(motion, StateMotion) or not delay_s:
            raise LinkError(
                f"{named}: robot '{robots[0].name}' needs motion: {{kind: state, delay_s: ...}}, "
                "the age of a state at its arrival"
            )
        if age_s > delay_s:
            raise LinkError(
                f"{named}: max_state_age_s {age_s:g} is above motion.delay_s {delay_s:g} of robot "
                f"'{robots[0].name}', the maximum age that the robot assumes; lower it, or leave "
                f"it out"
            )
        periods = 1.5 if cls._state(settings).derives else 1.0
        least_s = periods / settings.robot_state_rate_hz + settings.controller_delay_s
        if age_s <= least_s:
            key = "motion.delay_s" if settings.max_state_age_s is None else "max_state_age_s"
            raise LinkError(
                f"{named}: a state can be {least_s:.3g} s old ({periods:g} periods of "
                f"robot_state_rate_hz, and controller_delay_s), plus the time of the reply, but "
                f"{key} allows {age_s:g}; raise it, or read more often"
            )
        if cls._state(settings).derives and settings.robot_state_rate_hz * LONGEST_STEP_S < 1:
            raise LinkError(
                f"{named}: velocities are derived from positions at most {LONGEST_STEP_S:g} s "
                f"apart; raise robot_state_rate_hz to {math.ceil(1 / LONGEST_STEP_S)} or more, or "
                "give the addresses of the velocities"
            )
        return settings.model_copy(update={"max_state_age_s": age_s})

    @classmethod
    def _shares(cls, settings: P, traffic: Traffic) -> dict[str, float]:
        state = cls._state(settings)
        for shape in traffic.shapes:
            if shape.joints != len(state.joints):
                raise LinkError(
                    f"link '{settings.name}': joints has {len(state.joints)} entries, and the"
                    f" robot {shape.joints} joints; give each, in the order of its model"
                )
            if shape.moving_base != (state.base is not None):
                raise LinkError(
                    f"link '{settings.name}': base is for a robot whose base moves; "
                    + ("give it" if shape.moving_base else "remove it")
                )
        states = settings.robot_state_rate_hz * reading_s(len(state.places)) * len(traffic.robots)
        return {Status.__name__: 0.0, Advice.__name__: 0.0, RobotState.__name__: states}

    @staticmethod
    def _bitrate(settings: P) -> int:
        return BITRATE
