"""The register image as OPC UA variables: values, status codes and source timestamps."""

import time
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

from asyncua import Server, ua

from hri_drivers.links.plant.image import PLACES, Block, Image
from hri_predict.protocol.registers import (
    CHOSEN,
    NOT_AVAILABLE,
    Register,
    placed,
    unpacked,
)
from hri_predict.protocol.variables import (
    ARGUMENTS,
    CHOOSE,
    INDEX,
    METHOD,
    NAMESPACE,
    Variable,
    type_of,
    variables,
)

SHORTEST_NS = 1_000_000
"""Minimum interval between two reads of the image, regardless of the number of clients."""
SAME = timedelta(milliseconds=5)
"""Captures this close in time are the same: ages are whole milliseconds, and an Advice is
repeated."""
_UNITS = {"mm": "MMT", "mm/s": "C16", "ms": "C26"}  # UNECE Recommendation 20
_UNIT_TABLE = "http://www.opcfoundation.org/UA/units/un/cefact"
_AGES = {"AGE", "NEAREST_AGE"}


class Variables:
    """The variables of one server.

    Args:
        server: asyncua's, initialised.
        image: the blocks that the node wrote.
        robots: indices of the robots.
    """

    def __init__(self, server: Server, image: Image, robots: Sequence[int]) -> None:
        self._server, self._image = server, image
        self._variables = variables(robots)
        self._addresses = {each.address for each in self._variables}
        self._captured: dict[int, datetime] = {}
        self._shown: dict[str, tuple[int, int, datetime | None]] = {}
        self._looked_ns = 0

    @property
    def timeouts(self) -> int:
        """See ``Image``."""
        return self._image.timeouts

    async def create(self, pressed: Any, chosen: Any) -> None:
        """Create folders, variables and the methods.

        Args:
            pressed, chosen: called with the method's object and arguments.
        """
        if await self._server.register_namespace(NAMESPACE) != INDEX:
            raise RuntimeError("the server has other namespaces")
        top = self._server.get_objects_node()
        folders: dict[str, Any] = {"": top}
        for each in self._variables:
            folder = folders[""]
            *path, name = each.node_id.split(".")
            for k in range(len(path)):
                key = ".".join(path[: k + 1])
                if key not in folders:
                    folders[key] = await folder.add_folder(_id(key), _name(path[k]))
                folder = folders[key]
            kind = ua.VariantType[each.type]
            variable = await folder.add_variable(_id(each.node_id), _name(name), 0, kind)
            await _describe(variable, each.register)
        for name, called, registers in (
            (METHOD, pressed, ARGUMENTS),
            (CHOOSE, chosen, CHOSEN),
        ):
            await top.add_method(_id(name), _name(name), called, _arguments(registers), [])

    def put(self, block: Block, now_ns: int) -> None:
        """Process a block; its source timestamp is that of its capture, or else of its writing.

        Args:
            now_ns: when it was written, the machine's monotonic clock.
        """
        self._image.put(block, now_ns)
        back_ms = (time.monotonic_ns() - now_ns) / 1e6
        for at, register in placed(PLACES.get(block.address, ())):
            words = block.words[at : at + 1]
            if register.name in _AGES and words and words[0] != NOT_AVAILABLE:
                back_ms += words[0]
        captured = datetime.now(UTC) - timedelta(milliseconds=back_ms)
        before = self._captured.get(block.address)
        if before is None or abs(captured - before) > SAME:
            self._captured[block.address] = captured

    async def refresh(self, now_ns: int) -> None:
        """Write changed values; also called before each read, so that no old value looks fresh."""
        if 0 <= now_ns - self._looked_ns < SHORTEST_NS:
            return
        self._looked_ns = now_ns
        blocks = self._image.blocks(now_ns)
        values = {at: unpacked(PLACES[at], blocks[at][0]) for at in self._addresses}
        for each in self._variables:
            status = self._status(each, blocks[each.address][1])
            captured = self._captured.get(each.address)
            shown = (values[each.address][each.register.name], status, captured)
            if self._shown.get(each.node_id) != shown:
                self._shown[each.node_id] = shown
                await self._server.write_attribute_value(_id(each.node_id), _value(each, *shown))

    def _status(self, variable: Variable, stale: bool) -> int:
        if not stale:
            return ua.StatusCodes.Good
        if variable.address not in self._captured:
            return ua.StatusCodes.BadWaitingForInitialData
        if variable.register.stale is None:
            return ua.StatusCodes.UncertainLastUsableValue
        return ua.StatusCodes.BadNoCommunication


def _value(variable: Variable, value: int, status: int, captured: datetime | None) -> ua.DataValue:
    return ua.DataValue(
        ua.Variant(value, ua.VariantType[variable.type]),
        StatusCode=ua.StatusCode(status),
        SourceTimestamp=captured,
        ServerTimestamp=datetime.now(UTC),
    )


def _id(name: str) -> ua.NodeId:
    return ua.NodeId(name, INDEX)


def _name(name: str) -> ua.QualifiedName:
    return ua.QualifiedName(name, INDEX)


async def _describe(variable: Any, register: Register) -> None:
    """Add the register's meaning, and its unit with the UNECE code if it has one."""
    text = ua.DataValue(ua.Variant(ua.LocalizedText(register.text)))
    await variable.write_attribute(ua.AttributeIds.Description, text)
    if register.unit:
        code = _UNITS.get(register.unit)
        number = int.from_bytes(code.encode(), "big") if code else -1
        unit = ua.EUInformation(_UNIT_TABLE, number, ua.LocalizedText(register.unit))
        await variable.add_property(
            ua.NodeId(f"{variable.nodeid.Identifier}.EngineeringUnits", INDEX),
            ua.QualifiedName("EngineeringUnits", 0),
            unit,
        )


def _arguments(registers: Iterable[Register]) -> list[Any]:
    return [
        ua.Argument(
            Name=register.name,
            DataType=ua.NodeId(getattr(ua.ObjectIds, type_of(register))),
            ValueRank=-1,
            Description=ua.LocalizedText(register.text),
        )
        for register in registers
    ]
