"""``bench soak``: run for hours with random faults and check that the node stays safe."""

import json
from typing import Annotated

import typer


def soak(
    hours: Annotated[float, typer.Option(help="Hours of node time.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Random seed of the faults.")] = 0,
    speed: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=20,
            help="Seconds of node time per second, with real threads and clock; default: as "
            "fast as possible on the virtual clock.",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON.")] = False,
) -> None:
    """Run the demo's cell with random faults and a person always near; exit status 1 if one fails.

    Example: hri-predict bench soak --hours 0.1
    """
    from hri_sim.fault_table.soak import run_soak

    result = run_soak(hours, seed, speed)
    if as_json:
        print(json.dumps(result))
    else:
        for name, value in result.items():
            print(f"{name.replace('_', ' ')}: {value}")
    if not result["fine"]:
        raise typer.Exit(1)
