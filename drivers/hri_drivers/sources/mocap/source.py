"""The source of every kind of motion capture over UDP; each kind adds settings and a reader."""

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar

from hri_drivers.sources.live import LiveSource, sender_joints
from hri_drivers.sources.mocap.decoder import MocapDecoder
from hri_drivers.sources.mocap.frames import Reader
from hri_drivers.sources.one_sender import OneSender
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
