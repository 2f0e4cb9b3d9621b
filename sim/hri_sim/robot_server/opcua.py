"""The state as OPC UA variables: ``ns=2;s=Robot.Heartbeat``, ``.Mode``, ``.Joint1.Position``, ...

Positions are in degrees, as in OPC UA for Robotics (40010-1), velocities in degrees per second.
"""

import asyncio
import logging
import math
from collections.abc import Callable
from typing import Any

from asyncua import Server, ua

from hri_sim.robot_server.robot import JOINTS, LATE_S, Robot

NAMESPACE = "urn:hri-sim:robot"
ANY = ua.NodeId(ua.ObjectIds.Number)
NONE = ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadWaitingForInitialData))


async def serve(robot: Robot, address: tuple[str, int], ready: Callable[[int], None]) -> None:
    """Serve until cancelled; call ``ready`` with the port.

    Raises:
        OSError: it cannot listen on the address.
    """
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    server = Server()
    await server.init()
    host, port = address
    server.set_endpoint(f"opc.tcp://{f'[{host}]' if ':' in host else host}:{port}/")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    index = await server.register_namespace(NAMESPACE)
    ids = await _created(server, index)
    kinds: dict[ua.NodeId, ua.VariantType] = {}

    async def asked(*_: Any) -> None:
        robot.seen()
        if robot.has("late"):
            await asyncio.sleep(LATE_S)

    server.subscribe_server_callback(_read_callback(), asked)

    async def written() -> None:
        for node_id, value in zip(ids, _values(robot), strict=True):
            if value.VariantType != kinds.get(node_id):  # asyncua refuses another type
                kinds[node_id] = value.VariantType
                await server.write_attribute_value(node_id, NONE)
            await server.write_attribute_value(node_id, ua.DataValue(value))

    await server.start()
    assert server.bserver is not None
    ready(server.bserver.port)
    try:
        await robot.run(written)
    finally:
        await server.stop()


def _read_callback() -> Any:
    from asyncua.common.callback import CallbackType

    return CallbackType.PreRead


async def _created(server: Server, index: int) -> list[ua.NodeId]:
    """Create the variables: heartbeat, mode, then position and velocity of each joint."""
    joints = [f"Joint{n}.{what}" for n in range(1, JOINTS + 1) for what in ("Position", "Velocity")]
    ids = [ua.NodeId(f"Robot.{name}", index) for name in ("Heartbeat", "Mode", *joints)]
    for node_id in ids:
        name = ua.QualifiedName(str(node_id.Identifier), index)
        await server.nodes.objects.add_variable(node_id, name, None, datatype=ANY)
    return ids


def _values(robot: Robot) -> list[ua.Variant]:
    found = [ua.Variant(robot.beat, ua.VariantType.UInt16), ua.Variant(robot.mode)]
    for number, (at, moving) in enumerate(zip(robot.positions, robot.velocities, strict=True)):
        value: Any = math.degrees(at)
        if number == 2 and robot.has("not a number"):
            value = math.nan
        if number == 2 and robot.has("wrong type"):
            value = "12.5"
        found += [ua.Variant(value), ua.Variant(math.degrees(moving))]
    return found
