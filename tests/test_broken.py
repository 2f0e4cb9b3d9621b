"""The table of breaks fits the tree; that the tests find them, ``python -m tests.broken`` says."""

import pytest

from tests.broken import BREAKS, ROOT, Break, copied
from tests.house import MODULES, room_of


@pytest.mark.parametrize("broken", BREAKS, ids=lambda broken: broken.room)
def test_a_break_has_one_place_and_tests_that_run_first(broken: Break) -> None:
    text = (ROOT / broken.file).read_text(encoding="utf-8")
    assert text.count(broken.old) == 1
    assert broken.new != broken.old
    assert (ROOT / broken.tests).exists()
    assert (ROOT / broken.room_tests).is_dir()


def test_every_room_is_broken() -> None:
    rooms = {room_of(m) for m in MODULES if m.count(".") > 1 and m.startswith("hri_predict.")}
    rooms = {f"hri_predict/{room}" for room in rooms}
    for parent in ("drivers/hri_drivers", "sim/hri_sim"):
        rooms |= {f"{parent}/{f.parent.name}" for f in (ROOT / parent).glob("*/__init__.py")}
    assert {broken.room for broken in BREAKS} == rooms


def test_the_copy_holds_what_the_tests_read_and_nothing_built(tmp_path) -> None:
    tree = copied(ROOT, tmp_path)
    for name in ("pyproject.toml", "README.md", "hri_predict", "drivers/c", "configs", "tests"):
        assert (tree / name).exists()
    assert not list(tree.rglob("__pycache__"))
