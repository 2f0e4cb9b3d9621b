"""An id moves from a person who is then hidden to a colleague, who walks out."""

from hri_predict.base.skeleton import JOINTS
from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.incident import ALL_MODES, Incident
from hri_sim.fault_table.people import reaches_out, walks_out

_HIDES_S = 5.0


def _incident(name: str, place: list[float], *faults: str) -> Incident:
    """The worker is hidden from ``_HIDES_S`` on; the colleague stands at ``place``."""
    return Incident(
        name=f"identity: {name}",
        people=(reaches_out(12.0), walks_out(_HIDES_S + 3.0, place)),
        duration_s=28.0,
        faults=faults,
        settings={"source": {"keeps_ids": False}},
        modes=ALL_MODES,
        not_clear=(_HIDES_S, 28.0),
        says=(Reason.PERSON_LOST,),
    )


def _others(*parts: str) -> str:
    """The joints of all other parts of the body, as a list in a fault."""
    return ",".join(name for name in JOINTS if name[2:] not in parts)


_ONE_CAPTURE = "+0.03"
_AFTER = f"@{_HIDES_S}+23"
_BESIDE = [2.1, 0.35]

IDENTITY = (
    _incident(
        "one capture under a colleague's id",
        [2.9, 1.7],
        "vanish@0+4.99:person=1",
        f"vanish@4.99{_ONE_CAPTURE}:person=2",
        f"rename@4.99{_ONE_CAPTURE}:person=1,to=2",
        "vanish@5.02+23:person=1",
    ),
    _incident(
        "slides to a colleague 0.43 m behind",
        _BESIDE,
        f"vanish@0+{_HIDES_S}:person=2",
        f"vanish{_AFTER}:person=1",
        f"rename{_AFTER}:person=2,to=1",
    ),
    _incident(
        "a colleague appears 0.43 m beside, 0.4 s later",
        _BESIDE,
        f"vanish@0+{_HIDES_S + 0.4}:person=2",
        f"vanish{_AFTER}:person=1",
    ),
    _incident(
        "alternates between two people",
        _BESIDE,
        "vanish@0+3.5:person=1",
        "alternate@3.5+1.5:person=2,other=1",
        f"vanish{_AFTER}:person=1",
    ),
    _incident(
        "slides from arms to a colleague's legs",
        [2.3, 0.53],
        f"vanish@0+{_HIDES_S}:person=2",
        f"hide@4+1:person=1,joints=[{_others('elbow', 'wrist', 'hand')}]",
        f"vanish{_AFTER}:person=1",
        f"hide@5+1:person=2,joints=[{_others('knee', 'ankle', 'foot')}]",
        f"rename{_AFTER}:person=2,to=1",
    ),
)
