"""The house in figures: ``python -m tests.house`` prints what each room holds and imports.

Two figures say how far a reader has to go: the files that a frame passes on its way through the
node, and how often one tick of the node goes from one file to another.
"""

import ast
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Set
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {"hri_predict": ROOT, "hri_drivers": ROOT / "drivers", "hri_sim": ROOT / "sim"}

Arrows = Mapping[str, Set[str]]
"""Module -> the project's modules that it imports, wherever in its text."""


def modules() -> dict[str, Path]:
    """Return every module of the three packages, by its dotted name."""
    found = {}
    for package, base in PACKAGES.items():
        for path in sorted((base / package).rglob("*.py")):
            dotted = ".".join(path.relative_to(base).with_suffix("").parts)
            found[dotted.removesuffix(".__init__")] = path
    return found


MODULES = modules()


def room_of(module: str) -> str:
    """Return the room of a module; ``import hri_predict`` itself belongs to the library."""
    package, _, rest = module.partition(".")
    first = rest.split(".")[0]
    if package == "hri_predict":
        return first or "library"
    return f"{package}.{first}" if first else package


@cache
def nodes_of(source: str) -> list[ast.stmt]:
    """Return the imports and the functions, without their bodies, of a source text.

    The whole trees of all modules are millions of objects, through which the garbage collector
    would look in every test that comes after.
    """
    kept = ast.Import | ast.ImportFrom | ast.FunctionDef | ast.AsyncFunctionDef
    nodes: list[ast.stmt] = [n for n in ast.walk(ast.parse(source)) if isinstance(n, kept)]
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = []
    return nodes


def imported(source: str) -> Iterator[str]:
    """Yield the project's own modules that a source text imports."""
    for node in nodes_of(source):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [
                whole if (whole := f"{node.module}.{alias.name}") in MODULES else node.module
                for alias in node.names
            ]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] in PACKAGES)


@cache
def arrows_of() -> dict[str, set[str]]:
    """Return what each module imports."""
    return {
        module: (set(imported(path.read_text(encoding="utf-8"))) & set(MODULES)) - {module}
        for module, path in MODULES.items()
    }


def circles(arrows: Arrows) -> dict[str, list[str]]:
    """Return folder -> its files and folders that import each other in a circle, at any depth."""
    inside: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for module, others in arrows.items():
        for other in others:
            folder, child, import_of = _parted(module, other)
            inside[folder][child].add(import_of)
    found = {folder: _left(children) for folder, children in inside.items()}
    return {folder: left for folder, left in found.items() if left}


def _parted(module: str, other: str) -> tuple[str, str, str]:
    """Return the folder in which both are, and the child of it that each belongs to."""
    a, b = module.split("."), other.split(".")
    same = 0
    while same < min(len(a), len(b)) and a[same] == b[same]:
        same += 1
    first, second = (path[same] if same < len(path) else "__init__" for path in (a, b))
    return ".".join(a[:same]), first, second


def _left(children: Mapping[str, Set[str]]) -> list[str]:
    """Return the children in circles, and those between two circles."""
    left = {child: set(others) for child, others in children.items()}
    for other in {o for others in children.values() for o in others}:
        left.setdefault(other, set())
    while True:
        needed = {o for child, others in left.items() for o in others - {child}}
        done = {
            c for c, others in left.items() if not (others - {c}) & set(left) or c not in needed
        }
        if not done:
            return sorted(left)
        left = {child: others for child, others in left.items() if child not in done}


# -- the way of a frame ----------------------------------------------------------------------------


class _Steps:
    """Counts calls from one of the project's files into another one."""

    def __init__(self) -> None:
        self.files: set[str] = set()
        self.calls = self.hops = 0

    def __call__(self, frame: FrameType, event: str, _argument: Any) -> None:
        if event != "call" or (name := self._ours(frame)) is None:
            return
        self.calls += 1
        self.files.add(name)
        back = frame.f_back
        while back is not None and self._ours(back) is None:
            back = back.f_back
        self.hops += back is not None and self._ours(back) != name

    @staticmethod
    def _ours(frame: FrameType) -> str | None:
        name = frame.f_code.co_filename
        return name if any(f"/{package}/" in name for package in PACKAGES) else None


def frame_way(ticks: int = 50) -> tuple[int, float, float]:
    """Run the demo's cell; return files passed, and calls and changes of file in a tick."""
    from hri_predict.run.session import Options, View, run
    from hri_sim.baseline_demo import baseline_demo

    steps, seen = _Steps(), [0]

    class Watch(View):
        def on_tick(self, tick: Any) -> None:
            seen[0] += 1
            if seen[0] == 25:  # the start is over
                sys.setprofile(steps)
            elif seen[0] == 25 + ticks:
                sys.setprofile(None)

    run(baseline_demo(), Options(factor=None, duration_s=(40 + ticks) / 25, view=Watch()))
    return len(steps.files), steps.calls / ticks, steps.hops / ticks


def main() -> None:
    """Print a row for each room, then the totals."""
    arrows, lines = arrows_of(), {m: len(p.read_text().splitlines()) for m, p in MODULES.items()}
    between = {(room_of(m), room_of(o)) for m, others in arrows.items() for o in others}
    between = {(a, b) for a, b in between if a != b}
    print(f"{'room':<28}{'files':>7}{'lines':>8}{'imports':>9}")
    for room in sorted({room_of(m) for m in MODULES}):
        members = [m for m in MODULES if room_of(m) == room]
        out = sum(a == room for a, _ in between)
        print(f"{room:<28}{len(members):>7}{sum(lines[m] for m in members):>8}{out:>9}")
    tests = list((ROOT / "tests").rglob("*.py"))
    print(f"{'tests':<28}{len(tests):>7}{sum(len(p.read_text().splitlines()) for p in tests):>8}")
    single = sum(sum(m in others for others in arrows.values()) == 1 for m in MODULES)
    print(f"\nrooms {len({room_of(m) for m in MODULES})}, arrows between them {len(between)}")
    print(f"files {len(MODULES)}, lines {sum(lines.values())}, imported by one other {single}")
    print(f"circles {sum(map(len, circles(arrows).values()))}")
    files, calls, hops = frame_way()
    print(f"a frame's way: {files} files; a tick: {calls:.0f} calls, {hops:.0f} changes of file")


if __name__ == "__main__":
    main()
