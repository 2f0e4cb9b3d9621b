"""The source of every kind of motion capture over UDP; each kind adds settings and a reader."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

from hri_drivers.sources.live import LiveSource, sender_joints
from hri_drivers.sources.mocap.decoder import MocapDecoder
from hri_drivers.sources.mocap.frames import Reader
from hri_drivers.sources.udp_receiver import LARGEST, UdpReceiver
from hri_predict.base.clock import Clock
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.source import SourceCounters


class MocapSource(LiveSource, ABC):
    """See ``hri_predict.contracts.source.Source``.

    Attributes:
        root: root joint of the body, if the sender may send positions relative to it.
        largest: size in bytes of the longest datagram of this kind.

    Raises:
        ConfigError: the joint map is wrong.
    """

    root: ClassVar[str | None] = None
    largest: ClassVar[int] = 65_507

    def __init__(
        self,
        settings: Any,  # each kind's own
        base_dir: Path | None = None,
        clock: Clock | None = None,
    ) -> None:
        counters = SourceCounters()
        joint_map = self._joints(sender_joints(settings, base_dir))
        receiver = OneSender(
            settings.host,
            settings.port,
            getattr(settings, "multicast_group", None),
            self.largest,
            counters=counters,
        )
        decoder = MocapDecoder(
            reader=self._make_reader(settings, joint_map, counters),
            settings=settings,
            joint_map=joint_map,
            counters=counters,
            root=self.root,
            contradicted=lambda: receiver.contradicted,
        )
        super().__init__(
            settings=settings,
            receiver=receiver,
            decoder=decoder,
            counters=counters,
            joint_map=joint_map,
            clock=clock,
        )

    @abstractmethod
    def _make_reader(self, settings: Any, joint_map: JointMap, counters: SourceCounters) -> Reader:
        """Return the reader that extracts captures from datagrams."""

    def _joints(self, joint_map: JointMap) -> JointMap:
        """The joint map of the people that the reader returns."""
        return joint_map


SILENT_S = 1.0
"""Silence after which another sender may replace the current one."""


class OneSender(UdpReceiver):
    """See ``UdpReceiver``; datagrams of a second sender are refused and counted.

    The formats of motion capture do not identify the sender: the bones from two senders would be
    merged into one body, and one of two people would not be seen. While a second sender sends,
    ``contradicted`` is true.

    Args:
        host, port, multicast_group, largest: see ``UdpReceiver``.
        counters: counts ``refused``.
        now_s: a monotonic clock.
    """

    def __init__(
        self,
        host: str,
        port: int,
        multicast_group: str | None = None,
        largest: int = LARGEST,
        *,
        counters: SourceCounters,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(host, port, multicast_group, largest)
        self._counters = counters
        self._now_s = now_s
        self._sender: object = None
        self._heard_s = self._other_s = -SILENT_S

    @property
    def contradicted(self) -> bool:
        """Whether a second sender was heard recently."""
        return self._now_s() - self._other_s < SILENT_S

    def accepts(self, sender: object) -> bool:
        """Whether a datagram from this address is accepted."""
        now_s = self._now_s()
        if sender != self._sender:
            if now_s - self._heard_s < SILENT_S:
                self._other_s = now_s
                self._counters.refused += 1
                self._counters.note("two programs send to this port; stop one of them")
                return False
            self._sender = sender
        self._heard_s = now_s
        return True
