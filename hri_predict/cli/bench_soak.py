"""``bench soak``: hours with faults at random, and whether all held."""

import json
from typing import Annotated

import typer

from hri_predict import registry


def soak(
    hours: Annotated[float, typer.Option(help="Node hours.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Of the faults.")] = 0,
    speed: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=20,
            help="Node seconds per second, in real time with all threads; default as fast as "
            "possible, on the virtual clock.",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON alone.")] = False,
) -> None:
    """The demo's cell with faults at random, a person near all the time; status 1 if one gets by.

    Example: hri-predict bench soak --hours 0.1
    """
    result = registry.load("faults", "soak")(hours, seed, speed)
    if as_json:
        print(json.dumps(result))
    else:
        for name, value in result.items():
            print(f"{name.replace('_', ' ')}: {value}")
    if not result["fine"]:
        raise typer.Exit(1)
