"""The house: which room may import from which, and how large a file may be.

A frame goes one way, and so do imports: a room imports only from rooms below it, and only from
those that it is meant to know. ``MAY_IMPORT`` states every arrow that is allowed. Add one with
care: an arrow against the flow makes two rooms one.
"""

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {"hri_predict": ROOT, "hri_drivers": ROOT / "drivers", "hri_sim": ROOT / "sim"}
MAX_LINES = 400
SOURCES = ("*.py", "*.c", "*.h", "*.st")

# Files directly in hri_predict: "core" needs nothing, "contracts" say what a part must be (for a
# predictor ``predictors.base`` does), "library" is what ``import hri_predict`` offers (the version
# too, which the command line prints).
CORE = {"quantities"}  # a folder, because hri_predict is full
CONTRACTS = {"link", "peers", "registry"}
BASES = {"hri_predict.predictors.base"}
LIBRARY = {"__init__", "library"}

NODE = "core machine protocol robots contracts people predictors risk"
OFFLINE = "core machine contracts people predictors recording"
EVERYTHING = (
    f"{NODE} node alerting monitoring service recording evidence run discovery datasets evaluation "
    "training calibration"
)
MAY_IMPORT = {  # from the bottom to the top
    "core": "",
    "machine": "core",
    "protocol": "core",
    "discovery": "core protocol",
    "alerting": "core",
    "robots": "core machine protocol",
    "contracts": "core protocol robots",
    "people": "core machine protocol",
    "predictors": "core machine protocol contracts people",
    "risk": "core machine protocol contracts robots people predictors",
    "node": NODE,
    "monitoring": "core alerting protocol contracts people risk node",
    "service": "core protocol contracts people node monitoring",
    "recording": "core protocol contracts people predictors risk node",
    "evidence": "core protocol contracts risk node recording",
    "explaining": "core protocol recording",
    "run": f"{NODE} node monitoring service recording evidence discovery",
    "viewing": f"{NODE} node recording run",
    "datasets": OFFLINE,
    "evaluation": f"{OFFLINE} datasets",
    "training": f"{OFFLINE} datasets evaluation",
    "calibration": f"{OFFLINE} robots risk datasets evaluation",
    "library": EVERYTHING,
    "commissioning": f"{NODE} node recording evidence run library",
    "conformance": "core protocol contracts people predictors",
    "cli": f"{EVERYTHING} viewing explaining library commissioning conformance",
    "hri_drivers.wires": "core protocol contracts",
    "hri_drivers.links": "core protocol contracts hri_drivers.wires",
    "hri_drivers.sources": "core protocol discovery hri_drivers.wires",
    "hri_sim.people": "core",
    "hri_sim.replay": "core contracts recording",
    "hri_sim.referee": "core robots",
    "hri_sim.wires": "core protocol hri_drivers.wires",
    "hri_sim.senders": "core protocol hri_drivers.wires hri_drivers.sources hri_sim.wires",
    "hri_sim.faults": "core protocol contracts hri_drivers.wires",
    "hri_sim.controllers": "core protocol contracts robots hri_drivers.wires hri_drivers.links "
    "hri_sim.wires hri_sim.faults hri_sim.referee",
    "hri_sim.baseline_demo": "core run",
    "hri_sim.bench": f"{NODE} node run hri_drivers.wires hri_drivers.links hri_sim.people "
    "hri_sim.referee hri_sim.wires",
    "hri_sim.fault_table": f"{NODE} node monitoring run hri_drivers.wires hri_drivers.links "
    "hri_sim.people hri_sim.senders hri_sim.faults hri_sim.controllers hri_sim.baseline_demo",
    "hri_sim.simulation": f"{EVERYTHING} library hri_sim hri_sim.people hri_sim.replay "
    "hri_sim.referee hri_sim.controllers hri_sim.baseline_demo",
    "hri_drivers": "",
    "hri_sim": "",
}


def modules() -> dict[str, Path]:
    """Every module of the three packages, by its dotted name."""
    found = {}
    for package, base in PACKAGES.items():
        for path in sorted((base / package).rglob("*.py")):
            dotted = ".".join(path.relative_to(base).with_suffix("").parts)
            found[dotted.removesuffix(".__init__")] = path
    return found


MODULES = modules()


def room_of(module: str) -> str:
    package, _, rest = module.partition(".")
    first = rest.split(".")[0]
    if package != "hri_predict":
        return f"{package}.{first}" if first else package
    if module in BASES:
        return "contracts"
    if not first or first in LIBRARY:
        return "library"
    if first == "__main__":
        return "cli"
    if first in CORE:
        return "core"
    if first in CONTRACTS:
        return "contracts"
    return first if (ROOT / package / first).is_dir() else "core"


def imported(source: str, known: Mapping[str, object]) -> Iterator[str]:
    """The project's own modules that a source text imports, wherever in it."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [
                whole if (whole := f"{node.module}.{alias.name}") in known else node.module
                for alias in node.names
            ]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] in PACKAGES)


def forbidden(module: str, source: str) -> list[str]:
    """What ``source``, as the text of ``module``, imports and may not."""
    room = room_of(module)
    allowed = {room, *MAY_IMPORT.get(room, "").split()}
    return [name for name in imported(source, MODULES) if room_of(name) not in allowed]


def too_long(*folders: Path) -> dict[str, int]:
    """Path -> lines, of each source file somewhere in ``folders`` that has too many."""
    paths = (path for folder in folders for kind in SOURCES for path in folder.rglob(kind))
    lines = {str(path): path.read_text(encoding="utf-8").count("\n") for path in paths}
    return {path: count for path, count in lines.items() if count > MAX_LINES}


def test_every_room_is_listed():
    assert {room_of(m) for m in MODULES} <= set(MAY_IMPORT)


def test_no_room_may_import_against_the_flow():
    """The table itself has no circle: rooms are listed after all that they may import."""
    listed: list[str] = []
    for room, others in MAY_IMPORT.items():
        assert room.startswith("hri_") or set(others.split()) <= set(listed), room
        listed.append(room)


def test_imports_go_with_the_flow():
    found = {m: forbidden(m, path.read_text(encoding="utf-8")) for m, path in MODULES.items()}
    assert {module: names for module, names in found.items() if names} == {}


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("hri_predict.risk.engine", "from hri_predict.node.node import Node"),
        ("hri_predict.people.people", "import hri_predict.risk.engine"),
        ("hri_predict.discovery.announcer", "from hri_predict.run.config import Config"),
        ("hri_predict.node.node", "def late():\n    from hri_drivers.links.can import link"),
        ("hri_drivers.links.can.link", "from hri_sim.wires.pty import open_pty"),
        ("hri_drivers.sources.live", "from hri_drivers.links.slots import Slots"),
        ("hri_predict.predictors.base", "from hri_predict import cli"),
    ],
)
def test_an_import_against_the_flow_is_found(module, line):
    assert forbidden(module, line)


def test_no_import_circle():
    arrows = {
        module: set(imported(path.read_text(encoding="utf-8"), MODULES)) & set(MODULES)
        for module, path in MODULES.items()
    }
    left = dict(arrows)
    while left:  # take away whatever imports nothing that is left; a circle stays
        done = [m for m, others in left.items() if not (others - {m}) & set(left)]
        assert done, f"import circle among {sorted(left)}"
        for module in done:
            del left[module]


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
    outside = {"c", "plc", "python", "files"}  # of drivers/; and the parts of files.py
    for folder in (ROOT / "tests" / package).rglob("*"):
        if folder.is_dir() and folder.name != "__pycache__":
            relative = folder.relative_to(ROOT / "tests" / package)
            assert (mirrored / relative).is_dir() or relative.parts[0] in outside, folder


def _positional(path: Path) -> list[str]:
    """Functions of a file with more than four parameters that may be given by place."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
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
