"""``predictors``: list the installed predictors, and describe their shipped weights."""

import json
from typing import Any

from rich.console import Console
from rich.table import Table

from hri_predict.base.errors import HriPredictError
from hri_predict.cli.common import JsonOption
from hri_predict.contracts import registry


def predictors(
    as_json: JsonOption = False,
) -> None:
    """List the installed predictors.

    Example: hri-predict predictors
    """
    rows = [_predictor_row(name) for name in registry.names("predictors")]
    if as_json:
        print(json.dumps(rows))
        return
    table = Table()
    table.add_column("predictor", no_wrap=True)
    table.add_column("description")
    table.add_column("weights")
    for row in rows:
        table.add_row(row["name"], row["about"], _weights_text(row["weights"]))
    Console().print(table)


def _predictor_row(name: str) -> dict[str, Any]:
    """Describe a predictor, and the shipped weights of a trained one."""
    row: dict[str, Any] = {"name": name, "about": "", "weights": None}
    try:
        cls = registry.load("predictors", name)
        row["about"] = (cls.__doc__ or "").strip().partition("\n")[0].replace("``", "")
        # one around another predictor takes that one's
        from hri_predict.predictors.neural.network import Trained  # with torch: takes seconds

        if isinstance(cls, Trained) and "inner" not in cls.settings_model.model_fields:
            row["weights"] = _shipped(name)
    except HriPredictError as error:  # a broken predictor must not hide the others
        row["about"] = f"cannot be used: {error}"
    return row


def _shipped(name: str) -> dict[str, Any]:
    """Return what the header of a trained predictor's shipped weights states."""
    from hri_predict.predictors.neural.settings import shipped_weights
    from hri_predict.predictors.neural.weights import read_header  # with torch: takes seconds

    path = shipped_weights(name)
    if not path.exists():
        return {"path": None}
    header = read_header(path)
    rate_hz = header.shape.rate_hz
    return {
        "path": str(path),
        "rate_hz": rate_hz,
        "history_s": header.shape.history_steps / rate_hz,
        "horizon_s": header.shape.horizon_steps / rate_hz,
    }


def _weights_text(weights: dict[str, Any] | None) -> str:
    if weights is None:
        return ""
    if weights["path"] is None:
        return "none shipped: set predictor.weights to your own file"
    # validation errors are no comparison: not all were measured on the same recordings
    return (
        f"{weights['rate_hz']:g} Hz, {weights['history_s']:.2g} s of history, "
        f"{weights['horizon_s']:.2g} s ahead"
    )
