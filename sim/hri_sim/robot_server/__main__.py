"""A server with a swinging arm, to try out ``modbus_client`` and ``opcua_client``.

    python -m hri_sim.robot_server modbus

It prints a line of JSON with its port when it is ready. It stops with Ctrl-C. SIGUSR1 starts the
fault immediately, or ends it.
"""

import asyncio
import contextlib
import importlib
import signal
import sys
from enum import StrEnum
from typing import Annotated, cast

import typer

from hri_predict.base.installed import for_this_installation
from hri_sim.robot_server.robot import Fault, Robot
from hri_sim.rtde.listening import MOST_PORT, why_not


class Protocol(StrEnum):
    """Protocols of the server, and the package that each needs."""

    MODBUS = "modbus"
    OPCUA = "opcua"


PORTS = {Protocol.MODBUS: 5021, Protocol.OPCUA: 4841}
FAULTS = ("none", "frozen", "not a number", "late", "wrong type", "mode")


def main(
    protocol: Annotated[Protocol, typer.Argument(help="Protocol of the server.")],
    *,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[
        int | None,
        typer.Option(
            help="Port; 0: chosen by the system. Default: 5021, or 4841 for opcua.",
            min=0,
            max=MOST_PORT,
        ),
    ] = None,
    fault: Annotated[str, typer.Option(help=f"Fault of the server: {', '.join(FAULTS)}.")] = "none",
    after_s: Annotated[
        float, typer.Option(help="Time from the connection of a client to the start of the fault.")
    ] = 5.0,
) -> None:
    """Serve an arm's state until interrupted."""
    if fault not in FAULTS:
        _fail(f"--fault '{fault}': give one of {', '.join(FAULTS)}")
    try:
        module = importlib.import_module(f"hri_sim.robot_server.{protocol}")
    except ImportError as error:
        _fail(
            f"{error.name} is not installed; install it with: pip install 'hri-predict[{protocol}]'"
        )
    robot = Robot(cast(Fault, fault), after_s)
    signal.signal(signal.SIGUSR1, lambda *_: robot.toggle())
    address = (host, PORTS[protocol] if port is None else port)
    if why := why_not(address):
        _fail(why)
    try:
        asyncio.run(module.serve(robot, address, lambda p: print(f'{{"port": {p}}}', flush=True)))
    except OSError as error:
        _fail(
            why_not(address) or f"cannot listen on {host}:{address[1]}: {error.strerror or error}"
        )


def _fail(why: str) -> None:
    print(f"hri_sim.robot_server: {for_this_installation(why)}", file=sys.stderr)
    raise typer.Exit(2)


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError, KeyboardInterrupt):
        typer.run(main)
