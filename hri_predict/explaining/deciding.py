"""The deciding person, body part and robot part of a recorded advice, and their distances."""

from hri_predict.base.skeleton import CANONICAL, hidden_ends
from hri_predict.explaining.episodes import robot_of
from hri_predict.explaining.values import mapped, number, text, whole
from hri_predict.recording import RecordingInfo, Told


def part_of(advice: Told) -> str:
    """The deciding body part: ``r_hand``; "" if there is none."""
    index = whole(advice.data.get("body_part"))
    names = CANONICAL.segment_names
    if index is not None and 0 <= index < len(names):
        return names[index]
    return ""


def link_of(advice: Told, info: RecordingInfo) -> str:
    """The deciding robot part; "" if there is none."""
    index = whole(advice.data.get("robot_link"))
    for name, capsules in info.robots:
        if name == robot_of(advice.data) and index is not None and 0 <= index < len(capsules):
            return text(capsules[index])
    return "" if index is None else f"part {index}"


def person_of(advice: Told) -> int | None:
    """The deciding person."""
    return whole(mapped(advice.data.get("grounds")).get("person"))


def distance_of(advice: Told) -> float | None:
    """The deciding pair's distance; old recordings have only the overall minimum."""
    pair_m = number(mapped(advice.data.get("grounds")).get("pair_m"))
    return number(advice.data.get("separation_m")) if pair_m is None else max(0.0, pair_m)


def way_of(advice: Told) -> str:
    """The rule with the most slack, ``zones``, ``standard`` or ``contact``: it suffices."""
    grounds = mapped(advice.data.get("grounds"))
    return text(grounds.get("milder_way") or grounds.get("way"))


def milder_slack_of(advice: Told) -> float | None:
    """Return the slack by ``way_of``, if that is not the rule by which the pair was found."""
    return number(mapped(advice.data.get("grounds")).get("milder_slack_m"))


def needed_by(advice: Told) -> float | None:
    """Return the distance required for the robot's actual motion, by the pair's own rule."""
    has_m, slack_m = distance_of(advice), number(mapped(advice.data.get("grounds")).get("slack_m"))
    return None if has_m is None or slack_m is None else has_m - slack_m


def stated_hidden(advice: Told) -> int | None:
    """Return how many joints of the deciding body part were not seen, 0 to 2; ``None``: recordings
    of versions before 0.3 do not state it."""
    stated = whole(mapped(advice.data.get("grounds")).get("hidden_ends"))
    return None if stated is None else min(max(stated, 0), 2)


def hidden_of(advice: Told, info: RecordingInfo) -> int:
    """Return ``stated_hidden``; if not stated, 2 for a part that the source never delivers."""
    stated = stated_hidden(advice)
    if stated is not None:
        return stated
    unmapped = hidden_ends(part_of(advice), info.joint_map.mapped)
    return unmapped if unmapped == 2 else 0
