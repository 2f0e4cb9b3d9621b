"""``bench joint-maps``: volume of the zones around one standing body, for each tracker's joints."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from hri_predict.base.files import atomic_write
from hri_predict.cli.check.joint_map import StandingBody
from hri_predict.cli.common import JsonOption, without_effect
from hri_predict.contracts.joint_map import load_joint_map, map_names
from hri_predict.lab.calibration.body_model import (
    FITTED,
    HELD,
    JUDGED,
    fit_body_model,
    read_postures,
)
from hri_predict.lab.calibration.inferred import fitted
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_sim.bench.rows import Row, Scope, rows_of
from hri_sim.bench.table import report

_AT_S = (0.0, 0.4, 1.0)


def joint_maps(
    config: Annotated[
        Path | None,
        typer.Option(help="Configuration whose predictor and zones are used; default: the demo's."),
    ] = None,
    fit: Annotated[
        Path | None,
        typer.Option(
            help="Fit the positions of missing joints to the recordings in this folder, and print "
            "the result."
        ),
    ] = None,
    postures: Annotated[
        Path | None,
        typer.Option(help="With --fit: write the distribution of postures to this file."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare the shipped joint maps: the volume of the zones around a person who stands still.

    Missing joints are bounded by the skeleton's reach ("reach"), or inferred.

    Example: hri-predict bench joint-maps
    """
    if fit is not None:
        without_effect({"--config": config, "--json": as_json or None}, "with --fit")
        for name, (place, within) in fitted(fit).items():
            print(f'    "{name}": ({place}, {within}),')
        if postures is not None:
            _write_postures(fit, postures)
        return
    without_effect({"--postures": postures}, "without --fit")
    loaded = configuration.load(config or configuration.shipped("demo.yaml"))
    body = StandingBody(loaded, assemble.build_predictor(loaded))
    columns = {"joint map": "{joint_map}", "missing": "{missing}"}
    for k, seconds in enumerate(_AT_S):
        head = f"{1e3 * float(body.times_s[body.step_at(seconds)]):.0f} ms"
        columns[head] = f"{{reach[{k}]:.2f}}, {{inferred[{k}]:.2f}}"
    title = "Zones around a standing body, m3: by reach, inferred"
    report(list(_volumes(body)), as_json, title, columns)


def _volumes(body: StandingBody) -> Iterator[dict[str, Any]]:
    """Yield the volume of the zones in cubic metres for each joint map, by time."""
    steps = [body.step_at(seconds) for seconds in _AT_S]
    for name in map_names():
        if name != "bvh":  # built from each file's own names
            delivered = load_joint_map(name).mapped
            row: dict[str, Any] = {"joint_map": name, "missing": int(np.sum(~delivered))}
            for key, infers in (("reach", False), ("inferred", True)):
                volumes = body.cubic_metres(body.snapshot(delivered, infers)).sum(1)
                row[key] = [round(float(volumes[step]), 3) for step in steps]
            yield row


def rows(scope: Scope) -> Iterator[Row]:
    """Yield the volumes of the zones for each joint map, at the latest of the times."""
    loaded = configuration.load(configuration.shipped("demo.yaml")).with_predictor(scope.network)
    for line in _volumes(StandingBody(loaded, assemble.build_predictor(loaded))):
        farthest = {f"{key}_m3": line[key][-1] for key in ("reach", "inferred")}
        yield from rows_of([{"joint_map": line["joint_map"], **farthest}], "joint_map")


def _write_postures(data: Path, out: Path) -> None:
    model, errors = fit_body_model(read_postures(data, FITTED), read_postures(data, JUDGED))
    atomic_write(out, json.dumps(model.to_json(), separators=(",", ":")).encode())
    print(f"{out}: joints of other people are within, m, in {HELD:.0%}:")
    for title, joints in errors.items():
        print(f"    {title}: {', '.join(f'{joint} {at:.2f}' for joint, at in joints.items())}")
