"""``kind: natnet``: the skeletons of OptiTrack Motive; see ``packets``.

Motive's frame is right-handed in metres, with y up by default. Each skeleton is a person. A bone
that Motive does not track is unobserved.
"""

import contextlib
import ipaddress
import select
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from hri_drivers.sources.live import LiveSettings, LiveSource, sender_joints
from hri_drivers.sources.mocap.decoder import MocapDecoder
from hri_drivers.sources.mocap.frames import Frame, FrameError, person, stamp_of_s
from hri_drivers.sources.mocap.settings import GroupSettings
from hri_drivers.sources.natnet import packets
from hri_drivers.sources.natnet.packets import Bone, MocapFrame, Pose, request
from hri_drivers.sources.sent import SentPerson
from hri_drivers.sources.tcp import check_exposure
from hri_drivers.sources.udp_receiver import MulticastGroup, UdpReceiver, is_loopback
from hri_predict.base.arrays import Floats
from hri_predict.base.clock import Clock
from hri_predict.base.errors import SourceError
from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.contracts.source import SourceCounters

AXES = {"y": ("z", "x", "y"), "z": ("x", "y", "z")}
"""Axes forward, left and up for each up axis; ``room_from_source`` rotates about it."""


class NatNetSettings(GroupSettings):
    """``source:`` of ``kind: natnet``."""

    kind: Literal["natnet"]
    joint_map: str = Field("motive21", description="joint map of Motive's bones, or your own map")
    keeps_ids: bool = Field(True, description="a skeleton that returns is the same person")
    server: str = Field("127.0.0.1", description="address of the machine that runs Motive")
    command_port: int = Field(1510, ge=1, le=65535, description="Motive's command port")
    port: int = Field(
        1511, ge=1, le=65535, description="Motive's data port, used with a multicast group"
    )
    multicast_group: MulticastGroup = Field(
        None, description="Motive's multicast group, 239.255.42.99; default: unicast"
    )
    up: Literal["y", "z"] | None = Field(
        None, description="Motive's up axis, as streamed; default: the joint map's, y"
    )

    safety: ClassVar[Safety] = harmless("command_port")

    @field_validator("server")
    @classmethod
    def _address(cls, value: str) -> str:
        try:
            return str(ipaddress.IPv4Address(value))
        except ValueError:
            raise ValueError("must be an IPv4 address, such as 192.168.1.20") from None

    @model_validator(mode="after")
    def _known(self) -> Self:
        check_exposure(self.server, self.allow_unauthenticated)
        if is_loopback(self.host) and not is_loopback(self.server):
            raise ValueError(
                f"host {self.host} does not reach the server {self.server}; set 'host' to this "
                "machine's address in Motive's network"
            )
        return self


class NatNetSource(LiveSource):
    """See ``hri_predict.contracts.source.Source``."""

    settings_model: ClassVar[type[LiveSettings]] = NatNetSettings

    def __init__(
        self, settings: NatNetSettings, base_dir: Path | None = None, clock: Clock | None = None
    ) -> None:
        """Build the source without opening it.

        Raises:
            ConfigError: the joint map is wrong.
        """
        counters = SourceCounters()
        joint_map = sender_joints(settings, base_dir)
        if settings.up is not None:
            joint_map = joint_map.with_axes(AXES[settings.up])
        reader = NatNetReader(joint_map.source_joints, counters)
        super().__init__(
            settings=settings,
            receiver=NatNetReceiver(
                server=settings.server,
                command_port=settings.command_port,
                host=settings.host,
                group=settings.multicast_group,
                data_port=settings.port,
                wanted=lambda: reader.wanted,
            ),
            decoder=MocapDecoder(
                reader=reader, settings=settings, joint_map=joint_map, counters=counters
            ),
            counters=counters,
            joint_map=joint_map,
            clock=clock,
        )


ASK_S = 0.5
"""Interval of requests, and of the keep-alive messages that unicast needs."""
NEXT_S = 0.05
"""Interval if the needed information changes, for example to the models once the version is
known."""
LARGEST = 65_507
AT_ONCE = 64


class NatNetReceiver:
    """See ``hri_drivers.sources.live.Receiver``; receives only from the server.

    Args:
        server: address of the machine that runs Motive.
        command_port: Motive's.
        host: address of this machine's interface.
        group: the multicast group, or ``None`` for unicast.
        data_port: the group's port.
        wanted: returns the message to send next.
    """

    def __init__(
        self,
        *,
        server: str,
        command_port: int,
        host: str,
        group: str | None,
        data_port: int,
        wanted: Callable[[], int],
    ) -> None:
        self._server = (server, command_port)
        self._host = host
        self._group = None if group is None else _Group(server, host, data_port, group)
        self._wanted = wanted
        self._socket: socket.socket | None = None
        self._asked_s = -ASK_S
        self._asked: int | None = None

    def open(self) -> None:
        """Open the sockets.

        Raises:
            SourceError: the address is not this machine's, or the port is taken.
        """
        self.close()
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            opened.bind((self._host, 0))
        except OSError as error:
            opened.close()
            raise SourceError(
                f"udp {self._host}: {error.strerror}; correct 'host', the address of this machine"
            ) from error
        opened.setblocking(False)
        self._socket = opened
        if self._group is not None:
            self._group.open()

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the datagrams that have arrived; send the next request to Motive."""
        if self._socket is None:
            raise SourceError("natnet: the socket is closed; open it first")
        self._ask(self._socket)
        group = self._group.socket if self._group is not None else None
        sockets = [self._socket] if group is None else [self._socket, group]
        ready, _, _ = select.select(sockets, [], [], timeout_s)
        found = self._replies(self._socket) if self._socket in ready else []
        if self._group is not None and group in ready:
            found += self._group.read(0.0)
        return found

    def close(self) -> None:
        """Close the sockets."""
        opened, self._socket = self._socket, None
        if opened is not None:
            opened.close()
        if self._group is not None:
            self._group.close()

    def _ask(self, opened: socket.socket) -> None:
        now_s, wanted = time.monotonic(), self._wanted()
        if now_s - self._asked_s >= (ASK_S if wanted == self._asked else NEXT_S):
            self._asked_s, self._asked = now_s, wanted
            with contextlib.suppress(OSError):  # unreachable for now; it is asked again
                opened.sendto(request(wanted), self._server)

    def _replies(self, opened: socket.socket) -> list[bytes]:
        found: list[bytes] = []
        with contextlib.suppress(BlockingIOError, ConnectionError):
            for _ in range(AT_ONCE):
                data, sender = opened.recvfrom(LARGEST)
                if sender[0] == self._server[0]:
                    found.append(data)
        return found


class _Group(UdpReceiver):
    """The multicast group, in which only the server's datagrams are accepted."""

    def __init__(self, server: str, host: str, port: int, group: str) -> None:
        super().__init__(host, port, group, LARGEST)
        self._only = server

    @property
    def socket(self) -> socket.socket | None:
        """The open socket."""
        return self._socket

    def accepts(self, sender: object) -> bool:
        """Whether this address is the server's."""
        return isinstance(sender, tuple) and sender[0] == self._only


DAMAGED = 10
"""Number of damaged frames in a row after which the version is requested again, because Motive may
have been updated."""
LOCAL_M = 0.02
"""If all bones are this close to their offsets from their parents, coordinates are local."""


class NatNetReader:
    """See ``hri_drivers.sources.mocap.frames.Reader``.

    Args:
        joints: names of bones, the joints of the source.
        counters: counts ``ignored``.
    """

    def __init__(self, joints: Sequence[str], counters: SourceCounters) -> None:
        self._joints = joints
        self._counters = counters
        self._version: tuple[int, int] | None = None
        self._models: dict[int, dict[int, Bone]] | None = None
        self._damaged = 0

    @property
    def wanted(self) -> int:
        """The message to send to Motive next."""
        if self._version is None:
            return packets.CONNECT
        return packets.REQUEST_MODELS if self._models is None else packets.KEEP_ALIVE

    def reset(self) -> None:
        """Request everything again: another Motive may have started."""
        self._version = self._models = None
        self._damaged = 0

    def pause(self) -> None:
        """Do nothing: each frame is complete."""

    def read(self, data: bytes) -> Frame | None:
        """See ``Reader``."""
        message, found = packets.payload(data)
        if message == packets.SERVER_INFO:
            version = packets.version(found)
            if version != self._version:
                self._version, self._models = version, None
            return None
        if self._version is None or message not in (packets.MODELS, packets.FRAME):
            self._counters.ignored += 1
            return None
        if message == packets.MODELS:
            self._models = packets.models(found, self._version)
            return None
        frame = self._parsed(found)
        if frame.models_changed:
            self._models = None
        if self._models is None:
            self._counters.ignored += 1
            self._counters.note("natnet: frames before the model definitions")
            return None
        return self._frame(frame, self._models)

    def _parsed(self, data: bytes) -> MocapFrame:
        try:
            frame = packets.frame(data)
        except FrameError:
            self._damaged += 1
            if self._damaged >= DAMAGED:
                self.reset()
            raise
        self._damaged = 0
        return frame

    def _frame(self, frame: MocapFrame, models: Mapping[int, Mapping[int, Bone]]) -> Frame:
        if not frame.skeletons.keys() <= models.keys():
            self._models = None
            raise FrameError(
                "a skeleton without a model definition; requesting the definitions again"
            )
        if not models:
            self._counters.note(
                "natnet: Motive has no skeleton or does not stream it, so no person is seen; "
                "create a skeleton for each person and enable Skeletons in its streaming settings"
            )
        people = [self._person(k, pose, models[k]) for k, pose in frame.skeletons.items()]
        return Frame(
            stamp_ns=stamp_of_s(frame.time_s),
            number=frame.number,
            people=tuple(people),
            tracks=bool(models),
        )

    def _person(self, number: int, pose: Pose, bones: Mapping[int, Bone]) -> SentPerson:
        if _is_local(pose, bones):
            raise FrameError(
                "a relative stream: bones are in local coordinates; select Global in Motive's "
                "streaming settings (Skeleton Coordinates)"
            )
        found: Floats = np.full((len(self._joints), 3), np.nan)
        for bone, place in pose.positions.items():
            name = bones[bone].name if bone in bones else None
            if name in self._joints and bone in pose.tracked:
                found[self._joints.index(name)] = place
        if not {bone.name for bone in bones.values()} & set(self._joints):
            raise FrameError(
                "no bone of the joint map; select the bone naming convention Motive in its "
                "streaming settings, or correct 'joint_map'"
            )
        return person(number & 0xFFFF, found)


def _is_local(pose: Pose, bones: Mapping[int, Bone]) -> bool:
    """Whether every measured bone except the root is at its offset from its parent."""
    children = [
        k
        for k in pose.tracked & bones.keys()
        if bones[k].parent != 0 and np.isfinite(pose.positions[k]).all()
    ]
    return bool(children) and all(
        float(np.abs(pose.positions[k] - bones[k].offset).max(initial=0.0)) < LOCAL_M
        for k in children
    )
