"""Labels of markers that may name a person, too: ``Anna:LeftWrist``.

Motion capture programs put the subject's name and a colon before a marker's; the node writes the
person's id there. Files of one person have bare names.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hri_predict.errors import ConfigError
from hri_predict.scene import Floats

MAX_ID = 65535
MAX_MARKERS = 1_000_000  # of all people together, those included that a person does not have


@dataclass(frozen=True)
class Labelled:
    """Whose which marker is.

    Attributes:
        ids: of the people.
        joints: names, the same for all people.
        columns: (P, J) index of the label; -1 where a person has no such marker.
        note: what was left out, and who is who; "" if nothing.
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

    Left out, and counted in the note: what has no name or an automatic one (``*12``), those of
    ``left_out``, markers of nobody beside those of somebody, and all but the first of one name.

    Args:
        labels: of the file, in order.
        person: the id of those whom the file gives no number: the first; the next gets the next.
        left_out: labels of what is no position.

    Raises:
        ConfigError: no label is a marker's; or more people, or markers of them, than can be.
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
            f"its labels name {len(ids)} people with {len(joints)} different markers, more than "
            f"can be; give markers of one person one name before the colon"
        )
    _number(ids, person)
    columns = np.full((len(ids), len(joints)), -1, dtype=np.intp)
    row = {who: k for k, who in enumerate(ids)}
    for (who, joint), k in found.items():
        columns[row[who], joints[joint]] = k
    notes = [f"{skipped} of {len(labels)} labels are no markers of a person"] if skipped else []
    notes += [f"'{who}' is person {number}" for who, number in ids.items() if who != str(number)]
    note = "; ".join(notes) if several or skipped else ""
    return Labelled(tuple(ids.values()), tuple(joints), columns, note)


def split_label(label: str) -> tuple[str, str]:
    """``Anna:LeftWrist`` to ``("Anna", "LeftWrist")``; the first is "" where nobody is named.

    Behind an id a joint's own name may have a colon: ``2:rig:Hips`` is ``rig:Hips`` of person 2.
    """
    label = label.strip()
    first, _, rest = label.partition(":")
    if rest and _is_id(first):
        return first, rest
    who, _, joint = label.rpartition(":")
    return who, joint


def _is_id(who: str) -> bool:
    """Whether it is a person's number as ``joined_labels`` writes it; 07 is not 7."""
    number = who.isascii() and who.isdigit() and len(who) <= len(str(MAX_ID))
    return number and who == str(int(who)) and int(who) <= MAX_ID


def joined_labels(ids: Sequence[int], joints: Sequence[str]) -> list[str]:
    """Labels of people in order, and of each the joints; bare ones of one person."""
    if len(ids) == 1:
        return list(joints)
    return [f"{person}:{joint}" for person in ids for joint in joints]


def _number(ids: dict[str, int], person: int) -> None:
    """Give everybody an id: their own number, or the next that is free."""
    own = {who: int(who) for who in ids if _is_id(who)}
    taken = set(own.values())
    following = person
    for who in ids:
        if who not in own:
            while following in taken:
                following = (following + 1) % (MAX_ID + 1)
            own[who] = following
            taken.add(following)
        ids[who] = own[who]
