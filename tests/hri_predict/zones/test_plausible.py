"""A calibration whose zones would be absurdly small is refused; honest ones are far from that."""

import json

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.zones.calibration import FOLDER, OFS, load_calibration
from hri_predict.zones.plausible import (
    LEAST_MEAN_SHARE,
    LEAST_RADIUS_M,
    LEAST_SHARE,
    RISE_M_S,
    demand_radii,
    demand_scale,
    demand_shares,
)

SHIPPED = sorted(FOLDER.glob("*.calibration.json"))


def scaled(table, by):
    if isinstance(table, list):
        return [scaled(each, by) for each in table]
    return None if table is None else max(1, round(by(table)))


def whole(key, by):
    def edit(data):
        tables = data[key]
        data[key] = (
            scaled(tables, by)
            if isinstance(tables, list)
            else {of: scaled(table, by) for of, table in tables.items()}
        )

    return edit


def bias(value):
    return lambda data: data["scale"]["layers"][-1].update(biases=[value])


def one_row(key):
    """Damage one speed class of one level, of single joints."""
    return lambda data: data[key]["joint"][0].__setitem__(
        0, scaled(data[key]["joint"][0][0], lambda _: 1)
    )


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (whole("estimated_thousandths", lambda _: 1), "scale and estimated_thousandths give"),
        (whole("estimated_thousandths", lambda v: v / 200), "scale and estimated_thousandths"),
        (one_row("estimated_thousandths"), "scale and estimated_thousandths give a radius of"),
        (whole("limits_mm", lambda _: 1), "limits_mm holds 1 mm at 0.04 s"),
        (whole("limits_mm", lambda v: min(v, 20)), "limits_mm holds 20 mm at"),
        (one_row("limits_mm"), "limits_mm holds 1 mm"),
        (whole("guaranteed_mm", lambda _: 1), "guaranteed_mm holds 1 mm at 0.04 s"),
        (whole("guaranteed_mm", lambda v: v / 60), "guaranteed_mm holds"),
        (one_row("guaranteed_mm"), "guaranteed_mm holds 1 mm"),
        (whole("toward_thousandths", lambda _: 1), "toward_thousandths makes zones far too small"),
        (whole("toward_thousandths", lambda v: v / 5), "toward_thousandths makes zones far too"),
        (whole("toward_thousandths", lambda _: 60), "60 on average"),
        (bias(-9.0), "scale and estimated_thousandths give a radius of"),
        (bias(-8.0), "scale and estimated_thousandths give a radius of"),
        (lambda d: d["shape"].update(whole_shape(d)), "shape holds the factor 0.001"),
    ],
)
def test_zones_that_no_honest_fit_has_are_refused_in_one_line(tmp_path, edit, said):
    data = json.loads((FOLDER / "constant_velocity.calibration.json").read_text(encoding="utf-8"))
    edit(data)
    path = tmp_path / "own.calibration.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        load_calibration(path)
    line = str(error.value)
    assert said in line
    assert "far too small" in line
    assert line.endswith("make a new one: hri-predict calibrate")
    assert "\n" not in line


def whole_shape(data):
    return {"thousandths": scaled(data["shape"]["thousandths"], lambda _: 1)}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name.partition(".")[0])
def test_shipped_calibrations_are_far_above_the_bounds(path):
    found = load_calibration(path)
    assert found.guaranteed is not None
    assert found.estimated is not None
    assert found.limits is not None
    assert found.toward is not None
    for of in OFS:
        demand_radii("guaranteed", [found.guaranteed[of] / 6], found.rate_hz)
        demand_radii("limits", [found.limits[of] / 6], found.rate_hz)
        demand_scale(found.scale, found.shape, found.estimated[of] / 4, found.rate_hz)
    demand_shares(found.toward / 2)


def test_the_bounds_grow_with_the_horizon_and_unknown_radii_pass():
    times_s = np.arange(1, 31) / 25.0
    demand_radii("limits", [LEAST_RADIUS_M + RISE_M_S * times_s + 1e-9], 25.0)
    demand_radii("limits", [np.full(30, np.inf)], 25.0)
    with pytest.raises(ValueError, match="far too small"):
        demand_radii("limits", [np.full(30, 0.03)], 25.0)
    demand_shares(np.full(8, LEAST_MEAN_SHARE))
    with pytest.raises(ValueError, match="in one direction"):
        demand_shares(np.array([1.0] * 7 + [0.9 * LEAST_SHARE]))
