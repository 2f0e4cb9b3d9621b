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


def test_every_room_of_the_node_is_broken_once() -> None:
    rooms = {room_of(m) for m in MODULES if m.count(".") > 1 and m.startswith("hri_predict.")}
    broken = [b.room.removeprefix("hri_predict/") for b in BREAKS if b.room.startswith("hri_p")]
    assert sorted(broken) == sorted(rooms)


def test_the_copy_holds_what_the_tests_read_and_nothing_built(tmp_path) -> None:
    tree = copied(ROOT, tmp_path)
    for name in ("pyproject.toml", "README.md", "hri_predict", "drivers/c", "configs", "tests"):
        assert (tree / name).exists()
    assert not list(tree.rglob("__pycache__"))
