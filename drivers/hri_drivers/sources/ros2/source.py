"""``kind: ros2``: people in the messages of a ROS 2 node; see ``docs/guides/ros2.md``.

The joint map defines the number and order of the joints; positions are metres (REP-103) unless
``units`` states otherwise. Messages in frames other than ``frame`` need ``/tf``.
"""

import time
from collections.abc import Callable
from pathlib import Path

from hri_drivers.sources.live import LiveSource, Receiver, sender_joints
from hri_drivers.sources.ros2.decoder import Ros2Decoder
from hri_drivers.sources.ros2.settings import KINDS, Ros2SourceSettings
from hri_predict.base.clock import Clock
from hri_predict.base.errors import ConfigError
from hri_predict.contracts.joint_map import METRES_PER_UNIT
from hri_predict.contracts.source import SourceCounters
from hri_predict.protocol.ros.frame_tree import FrameTree
from hri_predict.protocol.ros.placing import PeopleReader


class Ros2Source(LiveSource):
    """See ``hri_predict.contracts.source.Source``."""

    settings_model = Ros2SourceSettings

    def __init__(
        self,
        settings: Ros2SourceSettings,
        base_dir: Path | None = None,
        clock: Clock | None = None,
        utc_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """Build the source without opening it.

        Raises:
            ConfigError: the joint map or the axes are wrong, or a package is missing.
        """
        joint_map = sender_joints(settings, base_dir).with_units(1.0).with_axes(settings.axes)
        counters = SourceCounters()
        receiver = _receiver(settings, counters)
        tree = FrameTree()
        self.decoder = Ros2Decoder(
            kind=KINDS[settings.message],
            topics=list(settings.topics),
            reader=PeopleReader(
                joint_map.source_joints, settings.frame, tree, METRES_PER_UNIT[settings.units]
            ),
            tree=tree,
            counters=counters,
            sees_room=settings.sees_room,
            by_arrival=settings.stamp == "arrival",
            utc_ns=utc_ns,
        )
        super().__init__(
            settings=settings,
            receiver=receiver,
            decoder=self.decoder,
            counters=counters,
            joint_map=joint_map,
            clock=clock,
        )

    @property
    def stamps_utc(self) -> bool:  # type: ignore[override]
        """See ``hri_predict.contracts.source.Live``; determined from the newest stamps."""
        return self.decoder.captures.clock == "utc"


def _receiver(settings: Ros2SourceSettings, counters: SourceCounters) -> Receiver:
    """Import ROS 2 only when a source is built: settings are checked and documented without it.

    Raises:
        ConfigError: ROS 2 is not installed, or cannot be loaded.
    """
    try:
        from hri_drivers.sources.ros2.receiver import Ros2Receiver
    except ImportError as error:
        raise ConfigError(
            f"source 'ros2' needs a package that is not installed: {error.name or error}; source "
            f"your ROS 2 installation, or pip install 'hri-predict[ros2]'"
        ) from error
    try:
        return Ros2Receiver(settings, counters)
    except ImportError as error:
        package = (error.name or str(error)).partition(".")[0]
        raise ConfigError(
            f"source 'ros2': 'message: {settings.message}' needs the ROS 2 package {package}; "
            f"source a workspace that has it, or apt install ros-jazzy-{package.replace('_', '-')}"
        ) from error
