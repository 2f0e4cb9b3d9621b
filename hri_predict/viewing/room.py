"""The regions of a room, for pictures: named zones and the field of view."""

from typing import Any

import yaml

from hri_predict.run.config import Config
from hri_predict.settings import Region


def room_of(config: Config) -> dict[str, Any]:
    """The regions of a configuration."""
    view = config.source.field_of_view
    return {
        "cell": config.path.stem,
        "named": [{"name": zone.name, **_region(zone)} for zone in config.node.zones],
        "view": None if view is None else _region(view),
    }


def room_of_text(text: str, cell: str) -> dict[str, Any]:
    """The regions of a configuration's text, as a recording has it; what is wrong is left out."""
    room: dict[str, Any] = {"cell": cell, "named": [], "view": None}
    try:
        data = yaml.safe_load(text)
        view = data["source"].get("field_of_view")
        zones = data.get("zones") or []
        room["view"] = None if view is None else _region(_checked(view))
        room["named"] = [{"name": str(zone["name"]), **_region(_checked(zone))} for zone in zones]
    except (yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError, RecursionError):
        pass
    return room


def _checked(data: dict[str, Any]) -> Region:
    return Region.model_validate({k: data[k] for k in Region.model_fields if k in data})


def _region(region: Region) -> dict[str, Any]:
    corners = [[float(x), float(y)] for x, y in region.polygon]
    return {"polygon": corners, "z_min": region.z_min, "z_max": region.z_max}
