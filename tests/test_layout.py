"""The house: which room may import from which, and how large a file may be.

A frame goes one way, and so do imports: a room imports only from rooms below it, and only from
those that it is meant to know. ``MAY_IMPORT`` states every arrow that is allowed. Add one with
care: an arrow against the flow makes two rooms one. Inside a room no two files or folders import
each other in a circle, at any depth.
"""

import ast
from pathlib import Path

import pytest

from tests.house import MODULES, PACKAGES, ROOT, arrows_of, circles, imported, nodes_of, room_of

MAX_LINES = 400
SOURCES = ("*.py", "*.c", "*.h", "*.st")

NODE = "base protocol robots contracts people predictors zones risk node"
RUN = f"{NODE} recording operation run"
MAY_IMPORT = {  # from the ground up
    "base": "",
    "protocol": "base",
    "robots": "base protocol",
    "contracts": "base protocol robots",
    "people": "base protocol contracts",
    "predictors": "base protocol contracts people",
    "zones": "base protocol contracts people",
    "risk": "base protocol robots contracts people zones",
    "node": NODE,
    "recording": "base protocol contracts people zones risk node",
    "operation": "base protocol contracts people risk node recording",
    "explaining": "base protocol contracts recording",
    "run": RUN,
    "lab": "base robots contracts people predictors zones recording run",
    "viewing": RUN,
    "library": f"{RUN} lab",
    "commissioning": f"{RUN} library",
    "cli": f"{RUN} explaining lab viewing library commissioning",
    "__main__": "cli",
    "hri_drivers": "",
    "hri_drivers.wires": "base protocol contracts",
    "hri_drivers.links": "base protocol robots contracts hri_drivers.wires",
    "hri_drivers.sources": "base protocol contracts hri_drivers.wires",
    "hri_drivers.camera": "base protocol robots contracts cli hri_drivers.wires "
    "hri_drivers.sources",
    "hri_sim": "",
    "hri_sim.rtde": "",
    "hri_sim.robot_server": "base hri_sim.rtde",
    "hri_sim.people": "base contracts",
    "hri_sim.replay": "base contracts recording",
    "hri_sim.referee": "base robots contracts",
    "hri_sim.wires": "base protocol hri_drivers.wires",
    "hri_sim.senders": "base protocol contracts hri_drivers.wires hri_drivers.sources "
    "hri_sim.wires hri_sim.people",
    "hri_sim.faults": "base protocol contracts hri_drivers.wires",
    "hri_sim.controllers": "base protocol robots contracts hri_drivers.wires hri_drivers.links "
    "hri_sim.wires hri_sim.faults hri_sim.referee",
    "hri_sim.baseline_demo": "base run",
    "hri_sim.fault_table": f"{RUN} hri_drivers.wires hri_drivers.links hri_sim.people "
    "hri_sim.robot_server hri_sim.wires hri_sim.senders hri_sim.faults hri_sim.controllers "
    "hri_sim.baseline_demo",
    "hri_sim.simulation": f"{RUN} lab library commissioning cli hri_sim.people hri_sim.replay "
    "hri_sim.referee hri_sim.controllers",
    "hri_sim.bench": f"{RUN} lab library cli hri_drivers.wires hri_drivers.links hri_sim.people "
    "hri_sim.referee hri_sim.wires hri_sim.senders hri_sim.robot_server hri_sim.fault_table "
    "hri_sim.simulation",
}


def forbidden(module: str, source: str) -> list[str]:
    """What ``source``, as the text of ``module``, imports and may not."""
    room = room_of(module)
    allowed = {room, *MAY_IMPORT.get(room, "").split()}
    return [name for name in imported(source) if room_of(name) not in allowed]


def too_long(*folders: Path) -> dict[str, int]:
    """Path -> lines, of each source file somewhere in ``folders`` that has too many."""
    paths = (path for folder in folders for kind in SOURCES for path in folder.rglob(kind))
    lines = {str(path): path.read_text(encoding="utf-8").count("\n") for path in paths}
    return {path: count for path, count in lines.items() if count > MAX_LINES}


def test_the_house_has_twenty_entries():
    rooms = {room_of(m) for m in MODULES if m.startswith("hri_predict.")}
    assert len(rooms | {"__init__"}) == 20
    assert all((ROOT / "hri_predict" / room).is_dir() for room in rooms - {"__main__"})


def test_every_room_is_listed():
    assert {room_of(m) for m in MODULES} <= set(MAY_IMPORT)


def test_no_room_may_import_against_the_flow():
    """The table itself has no circle: rooms are listed after all that they may import."""
    listed: list[str] = []
    for room, others in MAY_IMPORT.items():
        assert set(others.split()) - {room} <= set(listed), room
        listed.append(room)


def test_imports_go_with_the_flow():
    found = {m: forbidden(m, path.read_text(encoding="utf-8")) for m, path in MODULES.items()}
    assert {module: names for module, names in found.items() if names} == {}


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("hri_predict.risk.engine", "from hri_predict.node.node import Node"),
        ("hri_predict.people.people", "import hri_predict.risk.engine"),
        ("hri_predict.zones.radii", "from hri_predict.risk.settings import RiskSettings"),
        ("hri_predict.protocol.discovery.announcer", "from hri_predict.run.config import Config"),
        ("hri_predict.node.node", "def late():\n    from hri_drivers.links.can import link"),
        ("hri_predict.cli.run", "from hri_sim.bench import links"),
        ("hri_drivers.links.can.link", "from hri_sim.wires.pty import open_pty"),
        ("hri_drivers.sources.live", "from hri_drivers.links.slots import Slots"),
        ("hri_predict.contracts.predictor", "from hri_predict import cli"),
    ],
)
def test_an_import_against_the_flow_is_found(module, line):
    assert forbidden(module, line)


def test_no_circle_of_files_or_folders():
    assert circles(arrows_of()) == {}


@pytest.mark.parametrize(
    ("module", "other", "folder"),
    [
        ("hri_predict.risk.settings", "hri_predict.risk.levels.advice", "hri_predict.risk"),
        ("hri_predict.people.track", "hri_predict.people.lost.doors", "hri_predict.people"),
        ("hri_predict.zones.radii", "hri_predict.zones.body_zones", "hri_predict.zones"),
        ("hri_predict.base.files", "hri_predict.base.work.workers", "hri_predict.base"),
        ("hri_drivers.wires.transport", "hri_drivers.links.framed", "hri_drivers"),
    ],
)
def test_a_circle_that_is_added_is_found(module, other, folder):
    arrows = arrows_of()
    assert folder in circles(arrows | {module: arrows[module] | {other}})


def test_files_stay_small():
    assert too_long(*(ROOT / folder for folder in ("hri_predict", "drivers", "sim", "tests"))) == {}


@pytest.mark.parametrize("kind", SOURCES)
def test_a_file_that_is_too_long_is_found(kind, tmp_path):
    path = tmp_path / "deep" / kind.replace("*", "long")
    path.parent.mkdir()
    path.write_text(MAX_LINES * "\n")
    assert too_long(tmp_path) == {}
    path.write_text((MAX_LINES + 1) * "\n")
    assert too_long(tmp_path) == {str(path): MAX_LINES + 1}


@pytest.mark.parametrize("package", sorted(PACKAGES))
def test_tests_mirror_the_packages(package):
    """A folder of tests stands for the folder, or the file, of the same name."""
    mirrored = PACKAGES[package] / package
    outside = {"c", "plc", "python"}  # of drivers/
    for folder in (ROOT / "tests" / package).rglob("*"):
        if folder.is_dir() and folder.name != "__pycache__":
            relative = folder.relative_to(ROOT / "tests" / package)
            same = mirrored / relative
            assert (
                same.is_dir() or same.with_suffix(".py").is_file() or (relative.parts[0] in outside)
            ), folder


def _positional(path: Path) -> list[str]:
    """Functions of a file with more than four parameters that may be given by place."""
    found = []
    for node in nodes_of(path.read_text(encoding="utf-8")):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            names = [arg.arg for arg in (*node.args.posonlyargs, *node.args.args)]
            if len([name for name in names if name not in ("self", "cls")]) > 4:
                found.append(f"{path}: {node.name}")
    return found


def test_more_than_four_parameters_are_keywords_only(tmp_path: Path) -> None:
    files = [path for name, root in PACKAGES.items() for path in (root / name).rglob("*.py")]
    assert len(files) > 300
    found = [each for path in files for each in _positional(path)]
    assert found == []
    odd = tmp_path / "odd.py"
    odd.write_text("def f(a, b, c, d, e): ...\ndef g(self, a, b, c, d, *, e): ...\n")
    assert _positional(odd) == [f"{odd}: f"]
