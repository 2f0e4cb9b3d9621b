"""The fault injector: a source or a link with faults, and faults from the command line."""

from typing import Any

from hri_predict.base.errors import ConfigError
from hri_sim.faults.faulty_source import FaultySource
from hri_sim.faults.link_faults import LINK_FAULTS, FaultyTransport
from hri_sim.faults.settings import FaultSettings, Target, fault_mapping
from hri_sim.faults.source_faults import SOURCE_FAULTS

__all__ = ["LINK_FAULTS", "SOURCE_FAULTS", "FaultySource", "FaultyTransport", "parse_fault"]


def parse_fault(text: str, target: Target | None = None) -> dict[str, Any]:
    """Parse a fault as ``kind[@start[+duration]][:parameter=value,...]``.

    ``vanish@3+2`` begins 3 s after the start and lasts 2 s; without a duration it lasts to the end;
    ``teleport@3+2:person=1,offset=[0,3,0]`` sets parameters of the kind.

    Args:
        text: the fault.
        target: the fault's target; ``None`` accepts the kinds of both source and link.

    Returns:
        the fault as written under ``faults:`` in a configuration.

    Raises:
        ConfigError: wrong form, unknown kind (the error lists the known ones), or a parameter that
            this kind does not have.
    """
    source: dict[str, type[FaultSettings]] = dict(SOURCE_FAULTS)
    link: dict[str, type[FaultSettings]] = dict(LINK_FAULTS)
    if target is not None:
        return fault_mapping(text, source if target == "source" else link)
    kind = text.strip().partition("@")[0].partition(":")[0]
    if kind in source and kind in link:
        try:
            return fault_mapping(text, source)
        except ConfigError:
            return fault_mapping(text, link)
    return fault_mapping(text, link if kind in link else source | link)
