"""``calibrate --onto``: move a calibration towards the people of a site."""

import hashlib
import json
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hri_predict.base.errors import ConfigError
from hri_predict.cli.calibrate.inputs import Data, demand_horizon, warn_of_fitted, warn_of_simulated
from hri_predict.cli.calibrate.making import check_out, write_calibration
from hri_predict.cli.common import (
    check_writable,
    command,
    files,
    progress,
    result,
    tell,
    warn,
    writing,
)
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import PredictorSettings

if TYPE_CHECKING:
    from hri_predict.lab.calibration.site.parts import Part
    from hri_predict.zones.calibration import Calibration

SHIPPED = "shipped"


def commission(
    *,
    settings: PredictorSettings,
    data: Data,
    onto: str,
    out: Path,
    report: Path | None,
    as_json: bool,
) -> None:
    """Score the site's recordings, move the factors, write the file and print the gain."""
    from hri_predict.lab.calibration.site import gain as gains
    from hri_predict.lab.calibration.site.adapted import adapted

    check_out(out)
    if report is not None:
        check_writable(report)
    path, base = _base(settings, onto)
    if out.exists() and out.samefile(path):
        raise ConfigError(
            f"--out {out}: is the base calibration, which is not overwritten; name another file"
        )
    built = registry.load("predictors", settings.name)(settings)
    demand_horizon(built, settings, base, path)
    warn_of_simulated(data, "calibration")
    warn_of_fitted(settings, data, "calibration")
    parts = _parts(built, base, data)
    made = adapted(
        base=base,
        base_digest=hashlib.sha256(path.read_bytes()).hexdigest()[:16],
        parts=parts,
        skeleton=built.skeleton,
        made=date.today(),
    )
    gain = gains.measured_gain(base, parts, built.skeleton)
    write_calibration(out, made)
    tables = gains.tables(gain)
    notes = _notes(base, parts, made)
    found = {"file": str(out), "predictor": settings.name, **gains.as_json(gain), "notes": notes}
    written = [out]
    if report is not None:
        written += _written(report, _page(settings.name, notes, tables), found)
    tell(written)
    result(as_json, found, tables, notes)


def _base(settings: PredictorSettings, onto: str) -> "tuple[Path, Calibration]":
    """Return the base calibration and its file.

    Raises:
        ConfigError: there is none, or it does not fit.
    """
    from hri_predict.zones.calibration import load_calibration, mismatch, shipped_calibration

    path = shipped_calibration(settings.name) if onto == SHIPPED else Path(onto)
    if onto == SHIPPED and not path.is_file():
        raise ConfigError(
            f"--onto {SHIPPED}: no calibration is shipped for {settings.name}; make one from "
            f"recordings of many people without --onto"
        )
    base = load_calibration(path)
    if problem := mismatch(base, settings):
        raise ConfigError(
            f"--onto {path}: {problem}; give the calibration of the predictor that you run, or "
            f"make one without --onto"
        )
    if base.site is not None:
        raise ConfigError(
            f"--onto {path}: was already moved to a site; give the original calibration, and all "
            f"recordings of the site with --data"
        )
    return path, base


def _parts(built: Any, base: "Calibration", data: Data) -> "list[Part]":
    from hri_predict.lab.calibration.site.parts import score_parts

    found = files(data.entries, data.split, "calibration")
    known = {used.digest for used in base.recordings if used.digest}
    for path in found:
        if hashlib.sha256(path.read_bytes()).hexdigest() in known:
            raise ConfigError(
                f"--data: {path} is part of the base calibration and would count twice; leave it "
                f"out"
            )
    with progress() as bar:
        task = bar.add_task("forecasting", total=len(found))
        return score_parts(
            predictor=built,
            base=base,
            files=found,
            joint_map=data.joint_map,
            on_recording=lambda _: bar.advance(task),
            on_left_out=warn,
        )


def _notes(base: "Calibration", parts: "list[Part]", made: "Calibration") -> list[str]:
    """Notes for a reader of the tables."""
    from hri_predict.lab.calibration.site.mixing import GROW, SHRINK, weights_of
    from hri_predict.lab.calibration.site.parts import PART_S
    from hri_predict.zones.motion_class import SPEED_CLASSES

    weights = [weights_of([p.windows[c] for p in parts]).sum() for c in range(len(SPEED_CLASSES))]
    per = ", ".join(f"{name} {w:.1f}" for name, w in zip(SPEED_CLASSES, weights, strict=True))
    notes = [
        f"the base was made from {len(base.recordings)} recordings; here it counts as {GROW:g} "
        f"recordings where zones grow and as {SHRINK:g} where they shrink",
        f"parts of up to {PART_S / 60:g} minutes that show people: {len(parts)}; by speed they "
        f"count as {per}",
        "before and after compare the radii alone, without the live self-check and the physical "
        "limits of bodies",
    ]
    if _unchanged(base, made):
        notes.insert(0, f"too little data to change the zones (parts by speed: {per}); record more")
    if len(parts) == 1:
        notes.append("with only one part, none can be held out: record longer to measure the gain")
    else:
        notes.append(
            "after: each part is measured with factors moved by the parts far from it in time"
        )
    return notes


def _unchanged(base: "Calibration", made: "Calibration") -> bool:
    """Whether no factor moved by more than a thousandth, and no speed class was added."""
    import numpy as np

    from hri_predict.zones.calibration import OFS

    return all(np.allclose(made.estimated[of], base.estimated[of], rtol=1e-3) for of in OFS)


def _page(predictor: str, notes: list[str], tables: Any) -> str:
    head = f"# Zones of {predictor} at this site\n\n`{command()}`\n\n"
    said = "".join(f"- {note}\n" for note in notes)
    return head + said + "\n" + "\n".join(table.markdown() for table in tables)


def _written(folder: Path, text: str, report: dict[str, Any]) -> list[Path]:
    from hri_predict.base.files import atomic_write

    page, numbers = folder / "site.md", folder / "site.json"
    with writing(f"--report {folder}", "name another folder"):
        atomic_write(page, text.encode())
        atomic_write(numbers, (json.dumps(report, indent=1) + "\n").encode())
    return [page, numbers]
