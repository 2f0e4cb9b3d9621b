"""Facts of a configuration for pictures: seen and unseen space, and the band."""

from collections.abc import Iterable, Sequence
from typing import Any

import yaml
from pydantic import TypeAdapter

from hri_predict.base.files import load_yaml
from hri_predict.base.settings import Region, Vector3
from hri_predict.protocol.reason_row import Kind
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.settings import RiskSettings
from hri_predict.run.config import Config

_POINTS = TypeAdapter(list[Vector3])


def room_of(config: Config) -> dict[str, Any]:
    """Return the facts of a configuration.

    Where its source does not see free space (``sees_free_space``), ``shadows`` and ``viewpoints``
    are empty: the configuration has none.
    """
    source, people = config.source, config.node.people
    return _room(
        cell=config.path.stem,
        named=[(zone.name, zone) for zone in config.node.zones],
        view=source.field_of_view,
        shadows=source.shadows,
        viewpoints=source.viewpoints,
        sees_free_space=source.sees_free_space,
        walls=people.room,
        floor_m=people.floor_m,
    )


def room_of_text(text: str, cell: str) -> dict[str, Any]:
    """Return the room in the configuration's text of a recording; invalid parts are left out."""
    try:
        data = load_yaml(text)
        source, view = data["source"], data["source"].get("field_of_view")
        people = data.get("people") or {}
        walls = people.get("room")
        return _room(
            cell=cell,
            named=[(str(zone["name"]), _region(zone)) for zone in data.get("zones") or []],
            view=None if view is None else _region(view),
            shadows=[_region(each) for each in source.get("shadows") or []],
            viewpoints=_POINTS.validate_python(source.get("viewpoints") or []),
            sees_free_space=source.get("sees_free_space") is True,
            walls=None if walls is None else _region(walls),
            floor_m=float(people.get("floor_m", 0.0)),
        )
    except (yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError, RecursionError):
        return _room(cell=cell)


def sees(reasons: Iterable[Reason]) -> bool:
    """Return whether scenes can prove that a place is empty, given the reasons of Status."""
    return all(reason.row.kind is not Kind.INPUT for reason in reasons)


def band_of_text(text: str) -> float | None:
    """Return ``risk.band_m`` from a configuration's text; ``None`` if the text is invalid."""
    try:
        risk = load_yaml(text).get("risk") or {}
        return float(risk.get("band_m", RiskSettings.model_fields["band_m"].default))
    except (yaml.YAMLError, TypeError, ValueError, AttributeError, RecursionError):
        return None


def _room(
    *,
    cell: str,
    named: Sequence[tuple[str, Region]] = (),
    view: Region | None = None,
    shadows: Sequence[Region] = (),
    viewpoints: Sequence[Sequence[float]] = (),
    sees_free_space: bool = False,
    walls: Region | None = None,
    floor_m: float = 0.0,
) -> dict[str, Any]:
    return {
        "cell": cell,
        "named": [{"name": name, **_plain(zone)} for name, zone in named],
        "view": None if view is None else _plain(view),
        "shadows": [_plain(shadow) for shadow in shadows],
        "viewpoints": [[float(x) for x in point] for point in viewpoints],
        "sees_free_space": sees_free_space,
        "walls": None if walls is None else _plain(walls),
        "floor_m": floor_m,
    }


def _region(data: dict[str, Any]) -> Region:
    return Region.model_validate({k: data[k] for k in Region.model_fields if k in data})


def _plain(region: Region) -> dict[str, Any]:
    corners = [[float(x), float(y)] for x, y in region.polygon]
    return {"polygon": corners, "z_min": region.z_min, "z_max": region.z_max}
