"""Configuration of a CAN link, and whether two CAN links fit on one bus."""

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any, ClassVar, Self

from can.typechecking import CanFilter
from pydantic import Field, model_validator

from hri_drivers.links.can.transport import check_interface, listen_only_options
from hri_drivers.links.configured import ConfiguredLinkSettings
from hri_drivers.links.slots import BULK
from hri_drivers.links.supervised import BULK_AHEAD_NS
from hri_drivers.wires.serial import demand_serial_device
from hri_predict.base.errors import ConfigError, LinkError
from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.base.settings import Settings
from hri_predict.protocol.can import (
    CLASSIC_BYTES,
    DEFAULT_BASE_ID,
    FLOW_CONTROL_NUMBER,
    ISOTP_NUMBER,
    LAST_NUMBER,
    check_base_id,
)
from hri_predict.protocol.definition import frame_table
from hri_predict.protocol.wire import LinkKind, classic_bits, wire_bits

OWN_ARGUMENTS = ("interface", "bustype", "channel", "bitrate", "fd", "data_bitrate")
"""Arguments of python-can's bus with a separate key here; the link's load depends on them."""


MAX_ID = 0x1FFF_FFFF
"""Maximum id with 29 bits; ids with 11 bits get a further check."""


class IsoTpSettings(Settings):
    """``isotp:`` of a CAN link: the peer that receives Zone and Pose on classic CAN."""

    peer_id: int = Field(ge=0, le=MAX_ID, description="id of the peer's flow control frames")
    id: int | None = Field(
        None, ge=0, le=MAX_ID, description="id of the node's segments; default base_id + 0x46"
    )

    safety: ClassVar[Safety] = harmless("id")


class CanLinkSettings(ConfiguredLinkSettings):
    """An entry of ``links:`` with ``kind: can``."""

    kind: str = "can"
    interface: str = Field(description="any interface of python-can: socketcan, slcan, pcan, ...")
    channel: str | None = Field(
        None,
        min_length=1,
        coerce_numbers_to_str=True,
        description="can0, /dev/ttyACM0, 239.74.163.2, 0, ...; not needed with 'simulate'",
    )
    bitrate: int = Field(
        500_000,
        ge=10_000,
        le=1_000_000,
        description="bit rate of the bus; with FD, of its arbitration phase",
    )
    fd: bool = Field(False, description="CAN FD, which carries Zone and Pose without ISO-TP")
    data_bitrate: int = Field(
        2_000_000, ge=10_000, le=12_000_000, description="with FD, bit rate of the data phase"
    )
    base_id: int = Field(DEFAULT_BASE_ID, ge=0, le=MAX_ID, description="id of our first frame")
    extended: bool = Field(False, description="29-bit ids")
    isotp: IsoTpSettings | None = Field(
        None, description="classic CAN: Zone and Pose over ISO-TP, to one peer"
    )
    listen_only: bool = Field(
        False, description="receive from the controller; send nothing, not even acknowledge bits"
    )
    options: dict[str, Any] = Field({}, description="further arguments of python-can's bus")

    safety: ClassVar[Safety] = harmless(
        "bitrate", "fd", "data_bitrate", "base_id", "extended", "listen_only"
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        try:
            check_interface(self.interface)
            check_base_id(self.base_id, self.extended)
            if self.listen_only:
                listen_only_options(self.interface)
        except (LinkError, ConfigError) as error:
            raise ValueError(str(error)) from error
        for key in OWN_ARGUMENTS:
            if key in self.options:
                own = "interface" if key == "bustype" else key
                raise ValueError(f"options.{key}: set the link's own '{own}' instead")
        if self.options.get("receive_own_messages"):
            raise ValueError(
                "options.receive_own_messages: a link must not receive its own frames; remove it"
            )
        if self.channel is None and self.simulate is None:
            raise ValueError("give 'channel' (such as can0 or /dev/ttyACM0), or 'simulate'")
        if self.channel is not None and self.interface == "slcan":
            demand_serial_device(self.channel.partition("@")[0])
        if "/" in (self.channel or "") and self.interface == "socketcan":
            raise ValueError(
                f"channel {self.channel} is not a CAN interface; give one such as can0"
            )
        if self.fd and self.data_bitrate < self.bitrate:
            raise ValueError("data_bitrate must be at least bitrate")
        if self.isotp is not None:
            self._check_isotp(self.isotp)
        return self

    def _check_isotp(self, isotp: IsoTpSettings) -> None:
        if self.fd:
            raise ValueError(
                "isotp is for classic CAN; FD carries Zone and Pose itself, remove isotp"
            )
        if self.simulate is not None:
            raise ValueError(
                "isotp needs a peer, and the mock controller cannot be one; remove isotp"
            )
        if self.listen_only or not self.zones:
            why = "listen_only: true" if self.listen_only else "zones: false"
            raise ValueError(
                f"isotp sends Zone and Pose, but {why} forbids it; remove one of the two"
            )
        ours = self._own_ids()
        highest = self._highest
        for name, identifier in (("id", self.isotp_id), ("peer_id", isotp.peer_id)):
            if identifier > highest or identifier in ours:
                raise ValueError(
                    f"isotp.{name} {identifier:#x}: choose one up to {highest:#x} outside "
                    f"{min(ours):#x} to {max(ours):#x}, or {self.base_id + ISOTP_NUMBER:#x} for "
                    f"id and {self.base_id + FLOW_CONTROL_NUMBER:#x} for peer_id"
                )
        if self.isotp_id == isotp.peer_id:
            raise ValueError(f"isotp.id and isotp.peer_id are both {isotp.peer_id:#x}; change one")

    @property
    def isotp_id(self) -> int:
        """Id of the node's ISO-TP segments, if it sends any."""
        if self.isotp is None or self.isotp.id is None:
            return self.base_id + ISOTP_NUMBER
        return self.isotp.id

    @property
    def ids(self) -> list[int]:
        """All ids that belong to this link, ascending."""
        ids = self._own_ids()
        if self.isotp is not None:
            ids |= {self.isotp_id, self.isotp.peer_id}
        return sorted(ids)

    def _own_ids(self) -> set[int]:
        numbers = {*range(ISOTP_NUMBER), *frame_table(classic=not self.fd)}
        return {self.base_id + number for number in numbers}

    @property
    def heard_ids(self) -> list[int]:
        """All ids that a listener on this link receives, ascending."""
        return sorted({*self.ids, self.isotp_id}) if self.hears_isotp else self.ids

    @property
    def hears_isotp(self) -> bool:
        """Whether Zone and Pose may arrive over ISO-TP."""
        return not self.fd

    @property
    def _highest(self) -> int:
        return 0x1FFFFFFF if self.extended else 0x7FF

    @property
    def wire_kind(self) -> LinkKind:
        """Name of this kind of wire in the protocol."""
        return "can_fd" if self.fd else "can"

    @property
    def blocking_s(self) -> float:
        """Time of the longest frame; with Zone and Pose, plus that of the bytes written ahead."""
        one_s = classic_bits(CLASSIC_BYTES, self.extended) / self.bitrate
        if not self.fd:
            return one_s + BULK_AHEAD_NS * 1e-9 * (self.isotp is not None)
        frames = (
            wire_bits(message, "can_fd", self.extended).seconds(self.bitrate, self.data_bitrate)
            for message in BULK
        )
        return BULK_AHEAD_NS * 1e-9 + max(frames)

    @property
    def notes(self) -> list[str]:
        """Notes of ``check`` on this link."""
        notes = []
        if self.listen_only:
            notes.append(
                "listen_only: the link receives RobotState and Acknowledge, and sends no advice"
            )
            if self.interface == "socketcan":
                notes.append(
                    "listen_only: configure the device too, or it still acknowledges: ip link set "
                    f"{self.channel} up type can bitrate {self.bitrate} listen-only on"
                )
        elif self.zones and not self.fd and self.isotp is None:
            notes.append("classic CAN without 'isotp': this link does not send zones and poses")
        return notes


def id_filters(ids: Sequence[int], extended: bool, exact: bool) -> list[CanFilter]:
    """python-can's ``can_filters`` that pass ``ids`` (ascending).

    If ``exact``, several filters pass exactly these ids. Otherwise a single filter also passes some
    other ids, because most hardware has only one filter.
    """
    full = 0x1FFFFFFF if extended else 0x7FF
    if exact:
        blocks = list(_blocks(ids, full))
    else:
        varying = 0
        for identifier in ids:
            varying |= identifier ^ ids[0]
        blocks = [(ids[0], full & ~((1 << varying.bit_length()) - 1))]
    return [{"can_id": i & m, "can_mask": m, "extended": extended} for i, m in blocks]


def _blocks(ids: Sequence[int], full: int) -> Iterable[tuple[int, int]]:
    """Ids as a minimum number of aligned power-of-two blocks: (first id, mask)."""
    there, place = set(ids), 0
    while place < len(ids):
        first, size = ids[place], 1
        while first % (2 * size) == 0 and all(i in there for i in range(first, first + 2 * size)):
            size *= 2
        yield first, full & ~(size - 1)
        place += size


def check_together(links: Sequence[CanLinkSettings]) -> None:
    """Refuse links on one bus that would disturb each other.

    Raises:
        ConfigError: the message names both and the necessary change.
    """
    for a, b in combinations([link for link in links if link.simulate is None], 2):
        if (a.interface, a.channel) != (b.interface, b.channel):
            continue
        both = f"links '{a.name}' and '{b.name}' both use {a.channel}"
        if a.interface == "slcan":
            raise ConfigError(
                f"{both}, and an adapter serves one link; put their robots on one link"
            )
        if (a.bitrate, a.fd, a.data_bitrate if a.fd else 0) != (
            b.bitrate,
            b.fd,
            b.data_bitrate if b.fd else 0,
        ):
            raise ConfigError(
                f"{both}, but their bitrate, fd or data_bitrate differ; make them equal"
            )
        common = set(a.ids) & set(b.ids) if a.extended == b.extended else set()
        lowest = max(0, a.ids[0] - LAST_NUMBER)
        if common:
            shared, change = min(common), f"a base_id outside {lowest:#x} to {a.ids[-1]:#x}"
            named = b
            for link in (a, b):
                if link.isotp is not None and shared in (link.isotp_id, link.isotp.peer_id):
                    key = "isotp.peer_id" if shared == link.isotp.peer_id else "isotp.id"
                    named, change = link, f"another {key}"
            raise ConfigError(
                f"{both}, and both use the id {shared:#x}; give '{named.name}' {change}, or use "
                "one link for all robots"
            )
