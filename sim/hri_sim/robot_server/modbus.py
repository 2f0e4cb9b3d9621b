"""The state as Modbus registers: heartbeat at 100, mode at 101, then float32 from 102 on."""

import asyncio
import logging
import math
import struct
from collections.abc import Callable
from typing import Any

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from hri_sim.robot_server.robot import JOINTS, LATE_S, Robot

FIRST = 100
COUNT = 2 + 4 * JOINTS


async def serve(robot: Robot, address: tuple[str, int], ready: Callable[[int], None]) -> None:
    """Serve until cancelled; call ``ready`` with the port.

    Raises:
        OSError: it cannot listen on the address.
    """
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)

    async def asked(*request: Any) -> None:
        robot.seen()
        if robot.has("late"):
            await asyncio.sleep(LATE_S)
        request[4][:COUNT] = words(robot)

    blank = SimData(FIRST, values=[0] * COUNT, datatype=DataType.REGISTERS)
    server = ModbusTcpServer(SimDevice(0, simdata=[blank], action=asked), address=address)
    if not await server.listen():
        raise OSError(None, "the address is in use, or not this machine's")
    sockets: Any = getattr(server.transport, "sockets", None)
    ready(sockets[0].getsockname()[1])
    try:
        await robot.run()
    finally:
        await server.shutdown()


def words(robot: Robot) -> list[int]:
    """Return the current registers."""
    values = [*robot.positions, *robot.velocities]
    if robot.has("not a number"):
        values[2] = math.nan
    data = struct.pack(f">{2 * JOINTS}f", *values)
    floats = [int.from_bytes(data[k : k + 2], "big") for k in range(0, len(data), 2)]
    if robot.has("wrong type"):  # the low word first
        floats = [floats[k ^ 1] for k in range(len(floats))]
    return [robot.beat, robot.mode, *floats]
