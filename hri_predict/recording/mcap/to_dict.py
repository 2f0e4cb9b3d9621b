"""Output of the node in a tick, with the data needed to understand it later without the node."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from hri_predict.base.quantities.units import rounded
from hri_predict.contracts.link import Link
from hri_predict.node.node import Node
from hri_predict.protocol.messages import Advice, Status, at_encoding
from hri_predict.protocol.reasons import Reason
from hri_predict.recording.mcap.format import message_to_dict
from hri_predict.risk.types import Grounds, NamedZoneState


def status_to_dict(
    status: Status, now_ns: int, reasons: Sequence[Reason], named: Sequence[NamedZoneState]
) -> dict[str, Any]:
    """The node's state, with all reasons that hold: ``reason`` is only the worst."""
    return {
        **message_to_dict(at_encoding(status, now_ns)),
        "now_ns": now_ns,
        "reasons": list(dict.fromkeys(reason.name for reason in reasons)),
        "named_zones": {z.name: {"occupied": z.occupied, "entry_s": z.entry_s} for z in named},
    }


def advice_to_dict(
    advice: Advice, now_ns: int, robot: tuple[str, Sequence[str]], grounds: Grounds | None
) -> dict[str, Any]:
    """An advice to a robot of this name, with these names of capsules.

    ``level_number`` is the wire's.
    """
    name, capsules = robot
    return {
        **message_to_dict(at_encoding(advice, now_ns)),
        "now_ns": now_ns,
        "name": name,
        "level_number": int(advice.level),
        "speed_m_s": None if grounds is None else rounded(grounds.speed_m_s),
        "needed_m": None if grounds is None else rounded(grounds.needed_m),
        "grounds": None if grounds is None else _grounds(grounds, capsules),
    }


def _grounds(grounds: Grounds, capsules: Sequence[str]) -> dict[str, Any]:
    if grounds.unknown:
        return {"unknown": [reason.name for reason in grounds.unknown]}
    link, terms = grounds.link, grounds.terms
    named = link is not None and 0 <= link < len(capsules)
    return {
        "way": grounds.way,
        "person": grounds.person,
        "segment": grounds.segment,
        "robot_capsule": capsules[link] if named and link is not None else None,
        "pair_m": rounded(grounds.pair_m),
        "separation_m": rounded(grounds.separation_m),
        "slack_m": rounded(grounds.slack_m),
        **_milder(grounds),
        "hidden_ends": grounds.hidden_ends,
        "reaction_s": rounded(grounds.reaction_s),
        "stopping_s": rounded(grounds.stopping_s),
        "human_m_s": rounded(grounds.human_m_s),
        **({"place_error_m": rounded(grounds.place_error_m)} if grounds.place_error_m else {}),
        "terms_m": {} if terms is None else {k: rounded(v) for k, v in asdict(terms).items()},
        "protective_m": None if terms is None else rounded(terms.total),
    }


def _milder(grounds: Grounds) -> dict[str, Any]:
    if grounds.milder_slack_m is None:
        return {}
    return {
        "milder_way": grounds.milder_way,
        "milder_slack_m": rounded(grounds.milder_slack_m),
    }


def counters_of(
    node: Node, links: Sequence[Link], loop: Mapping[str, int] | None = None
) -> Mapping[str, Any]:
    """Return the counters since the start; of links only those above 0. Loop's thread only.

    ``loop``: counters of the loop that calls the node, such as late ticks.
    """
    own = {
        "scenes_in": node.scenes_in,
        "frames_in": node.frames_in,
        "assess_failures": node.assess_failures,
        "listener_failures": node.listener_failures,
        "strange_states": node.strange_states,
        "acknowledges": node.acknowledges,
        "acknowledges_refused": node.acknowledges_refused,
        **node.robot_counters,
        **(loop or {}),
    }
    return {"node": own, "links": {link.name: _link(link) for link in links}}


def _link(link: Link) -> dict[str, Any]:
    counted = {name: count for name, count in asdict(link.counters).items() if count}
    return {"connected": link.connected, "last_error": link.last_error, "counters": counted}
