"""One attack of each kind, in a mode of its own; ``python -m tests.attacks`` draws many."""

import pytest

from tests.attacks.__main__ import MODES, attack
from tests.attacks.kinds import KINDS


@pytest.mark.long
@pytest.mark.parametrize("number", range(len(KINDS)), ids=list(KINDS))
def test_an_attack_ends_without_contact_and_without_clear_beside_a_person(number):
    kind = list(KINDS)[number]
    name, outcome = attack(kind, 0, number, MODES[number % len(MODES)])
    assert outcome.fine, f"{name}: {outcome}"
