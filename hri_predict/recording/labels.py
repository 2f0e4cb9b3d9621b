"""Labels of markers, which may include a person's name: ``Anna:LeftWrist``.

Motion capture programs put the subject's name and a colon before a marker's; the node writes the
person's id there. Files of one person have names without a prefix.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError

MAX_ID = 65535
MAX_MARKERS = 1_000_000  # people times joints


@dataclass(frozen=True)
class Labelled:
    """Assignment of labels to persons and joints.

    Attributes:
        ids: ids of the people.
        joints: names of the joints, the same for all people.
        columns: (P, J) index of the label; -1 where a person has no such marker.
        note: names left out, and the person of each name; "" if none.
    """

    ids: tuple[int, ...]
    joints: tuple[str, ...]
    columns: NDArray[np.intp]
    note: str

    def people(self, points: Floats) -> Floats:
        """(F, labels, 3) to (F, P, J, 3); NaN where a person has no such marker."""
        found: Floats = points[:, self.columns]
        found[:, self.columns < 0] = np.nan
        return found


def split_labels(labels: Sequence[str], person: int, left_out: Sequence[str] = ()) -> Labelled:
    """Sort labels by person.

    Left out, and counted in the note: labels without a name or with an automatic one (``*12``), the
    labels in ``left_out``, labels without a person where others have one, and repeated labels.

    Args:
        labels: labels of the file, in order.
        person: id for the first person without a number; the next one gets the next id.
        left_out: labels that are not positions.

    Raises:
        ConfigError: no label is a marker's, or there are too many people or markers.
    """
    named = [split_label(label) for label in labels]
    several = any(who for who, _ in named)
    ids: dict[str, int] = {}
    joints: dict[str, int] = {}
    found: dict[tuple[str, str], int] = {}
    passed_over = frozenset(left_out)
    skipped = 0
    for k, (label, (who, joint)) in enumerate(zip(labels, named, strict=True)):
        automatic = not joint or joint.startswith("*")
        if automatic or (several and not who) or label in passed_over or (who, joint) in found:
            skipped += 1
            continue
        found[who, joint] = k
        joints.setdefault(joint, len(joints))
        ids.setdefault(who, 0)
    if not found:
        raise ConfigError(f"none of its {len(labels)} points has a name; name them")
    if len(ids) > MAX_ID or len(ids) * len(joints) > MAX_MARKERS:
        raise ConfigError(
            f"its labels name {len(ids)} people with {len(joints)} different markers, which is "
            f"too many; give all markers of a person the same name before the colon"
        )
    ids = numbered(ids, person)
    columns = np.full((len(ids), len(joints)), -1, dtype=np.intp)
    row = {who: k for k, who in enumerate(ids)}
    for (who, joint), k in found.items():
        columns[row[who], joints[joint]] = k
    notes = [f"{skipped} of {len(labels)} labels are not markers of a person"] if skipped else []
    notes += [f"'{who}' is person {number}" for who, number in ids.items() if who != str(number)]
    note = "; ".join(notes) if several or skipped else ""
    return Labelled(tuple(ids.values()), tuple(joints), columns, note)


def split_label(label: str) -> tuple[str, str]:
    """``Anna:LeftWrist`` to ``("Anna", "LeftWrist")``; the first is "" if no person is named.

    After an id a joint's own name may have a colon: ``2:rig:Hips`` is ``rig:Hips`` of person 2.
    """
    label = label.strip()
    first, _, rest = label.partition(":")
    if rest and _is_id(first):
        return first, rest
    who, _, joint = label.rpartition(":")
    return who, joint


def _is_id(who: str) -> bool:
    """Whether the text is a person's number as written by ``joined_labels``; 07 is not 7."""
    number = who.isascii() and who.isdigit() and len(who) <= len(str(MAX_ID))
    return number and who == str(int(who)) and int(who) <= MAX_ID


def joined_labels(ids: Sequence[int], joints: Sequence[str]) -> list[str]:
    """Return labels by person and joint; joint names without a prefix for a single person."""
    if len(ids) == 1:
        return list(joints)
    return [f"{person}:{joint}" for person in ids for joint in joints]


def numbered(names: Collection[str], person: int) -> dict[str, int]:
    """Assign an id to each person's name: its own number, or the next free one.

    Args:
        names: different ones.
        person: the id for the first person without a number.
    """
    ids = {who: int(who) for who in names if _is_id(who)}
    taken = set(ids.values())
    following = person
    for who in names:
        if who not in ids:
            while following in taken:
                following = (following + 1) % (MAX_ID + 1)
            ids[who] = following
            taken.add(following)
    return {who: ids[who] for who in names}
