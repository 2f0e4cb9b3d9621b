"""A controller whose arm obeys the speed slider, to try out ``kind: rtde`` without a robot.

    python -m hri_sim.rtde

It prints a line of JSON with its port when it is ready, then one for each change of a client's
inputs. It stops with Ctrl-C.
"""

import asyncio
import contextlib
import json
import sys
import time
from typing import Annotated, Any

import typer

from hri_sim.rtde.arm import Arm
from hri_sim.rtde.listening import MOST_PORT, why_not
from hri_sim.rtde.server import Behaviour, Controller


def main(
    *,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(help="Port; 0: chosen by the system.", min=0, max=MOST_PORT)
    ] = 30_004,
    watchdog_register: Annotated[
        int, typer.Option(help="Number of the watchdog register, as in the link's settings.")
    ] = 24,
    level_register: Annotated[
        int, typer.Option(help="Number of the level register, as in the link's settings.")
    ] = 25,
    watchdog_s: Annotated[
        float,
        typer.Option(
            help="Pause the program after this many seconds without a watchdog change; 0: never."
        ),
    ] = 0.06,
    each: Annotated[bool, typer.Option(help="Print every data package, with its time.")] = False,
    refuse_version: Annotated[bool, typer.Option(help="Refuse protocol version 2.")] = False,
    lacks: Annotated[
        list[str] | None,
        typer.Option(help="Name of an input or output that is reported as not found."),
    ] = None,
    silent_after_s: Annotated[
        float, typer.Option(help="Seconds after which no more data is sent.")
    ] = 1e9,
    garbage_after_s: Annotated[
        float, typer.Option(help="Seconds after which invalid bytes are sent.")
    ] = 1e9,
    piece: Annotated[int, typer.Option(help="Send packets in pieces of this many bytes.")] = 0,
    frozen: Annotated[bool, typer.Option(help="Keep the time stamp constant.")] = False,
) -> None:
    """Serve RTDE until interrupted."""
    behaviour = Behaviour(
        refuse_version=refuse_version,
        lacks=frozenset(lacks or ()),
        silent_after_s=silent_after_s,
        garbage_after_s=garbage_after_s,
        piece=piece,
        frozen=frozen,
    )
    arm = Arm(watchdog_s)
    said: dict[str, Any] = {}

    def written(values: dict[str, Any]) -> None:
        counts = f"input_int_register_{watchdog_register}"
        shown = {
            "slider": round(values.get("speed_slider_fraction", 0.0), 3),
            "level": values.get(f"input_int_register_{level_register}"),
            "safety_mode": arm.safety_mode,
        }
        if each:
            shown |= {"watchdog": values.get(counts), "at_ns": time.monotonic_ns()}
        if shown != said:
            said.clear()
            said.update(shown)
            print(json.dumps(shown), flush=True)

    controller = Controller(arm, (watchdog_register, level_register), behaviour, written)
    try:
        asyncio.run(controller.serve(host, port, lambda p: print(f'{{"port": {p}}}', flush=True)))
    except OSError as error:
        why = why_not((host, port)) or f"cannot listen on {host}:{port}: {error.strerror or error}"
        print(f"hri_sim.rtde: {why}", file=sys.stderr)
        raise typer.Exit(2) from error


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError, KeyboardInterrupt):
        typer.run(main)
