"""Imports go strictly downward, and the package keeps the rules of the house.

The oracle of every test here is the syntax tree of the source files; what is
compared are lists of offenders, which are empty.
"""

import ast
import functools
import re
import sys
from pathlib import Path

from tests import source_files
from tests.source_files import ROOT, imports, module_name, python_files

# The rooms of the house, floor by floor, the lowest first: a room imports from
# itself and from the floors below it.
FLOORS = (
    "parameters",
    "core.math",
    "core.walking",
    "core.body palette",
    "core.estimation core.steps core.whole_body new_robot",
    "core.plan",
    "core.feedback robot",
    "systems",
    "balance_controller policy engines view",
    "results wire",
    "diagrams",
    "sweep",
    "scripts",
)
FLOOR = {
    f"nadia_balance.{room}": floor
    for floor, rooms in enumerate(FLOORS)
    for room in rooms.split()
}
PACKAGE = python_files("nadia_balance")
LIMIT = Path("nadia_balance/sweep/lipm_limit.py")
MATHEMATICS = [*python_files("nadia_balance/core"), LIMIT]
RUNTIME = python_files("nadia_balance", "diagrams", "scripts")


@functools.cache
def imported(path: Path) -> set[str]:
    """The full dotted names of what a file imports."""
    return set(imports(source_files.syntax_tree(path)))


def room_of(module: str) -> str:
    """The room that holds `module`, or the name in it; "" if none does."""
    rooms = [r for r in FLOOR if f"{module}.".startswith(f"{r}.")]
    return max(rooms, key=len, default="")


def offenders(breaks_rule, paths=RUNTIME) -> list[str]:
    """Every import of `name` in a `path` that breaks a rule of both."""
    return [
        f"{path}: {name}"
        for path in paths
        for name in imported(path)
        if breaks_rule(path, name)
    ]


def test_every_file_is_in_a_room_and_every_room_has_a_file():
    """But the front door, which is above all: it imports when it is asked."""
    assert {room_of(module_name(path)) for path in RUNTIME} - {""} == set(FLOOR)
    outside = [path for path in RUNTIME if not room_of(module_name(path))]
    doors = "nadia_balance/__init__.py", "nadia_balance/core/__init__.py"
    assert outside == [*map(Path, doors)]
    assert Path("nadia_balance/core/walking/state.py") in PACKAGE


def test_our_modules_are_imported_at_the_top_of_a_file():
    """But those that need an extra: no circle is cut in a function.

    Oracle: the syntax tree; what is nested in no function is on its top level.
    """
    nested = [
        f"{path}: {name}"
        for path in RUNTIME
        for node in ast.walk(source_files.syntax_tree(path))
        if isinstance(node, ast.FunctionDef)
        for name in imports(node)
        if name.startswith("nadia_balance.")
    ]
    extras = (
        "nadia_balance.new_robot.make.",
        "nadia_balance.engines.mujoco_m",
        "nadia_balance.wire.unitree",
    )
    names = {one.partition(": ")[2] for one in nested}
    assert [name for name in names if not name.startswith(extras)] == []


def test_contributing_shows_the_floors():
    """Oracle: the table here."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    rows = re.findall(r"^\| (\d+) \|(.*)\|$", text, re.MULTILINE)
    shown = [(int(n), re.findall(r"`([\w.]+)`", row)) for n, row in rows]
    assert shown == [(i, rooms.split()) for i, rooms in enumerate(FLOORS, 1)]


def test_imports_only_its_own_room_and_those_on_lower_floors():
    """Oracle: the table; so no rooms import each other in a circle."""

    def climbs(path: Path, name: str) -> bool:
        here, there = room_of(module_name(path)), room_of(name)
        return here != there and FLOOR.get(there, -1) >= FLOOR.get(here, 99)

    assert not offenders(climbs)


def test_nothing_is_imported_from_the_top_of_the_repository():
    """An installation has `nadia_balance` only: the rest is inside of it."""
    folders = ("diagrams", "models", "scripts", "tests")
    assert not offenders(lambda _, name: name.split(".")[0] in folders)


def test_core_and_the_limit_are_pure_mathematics():
    """Only the QP files know Drake, and of Drake only its solvers.

    DAQP is one of these, in a file of its own.
    """
    pure = {"numpy", "nadia_balance", *sys.stdlib_module_names}

    def impure(path: Path, name: str) -> bool:
        words = {*path.stem.split("_")}
        if words & {"qp", "daqp"} and name.startswith("pydrake.solvers"):
            return False
        if path.stem == "daqp_solver" and name == "daqp":
            return False
        return name.split(".")[0] not in pure

    assert not offenders(impure, MATHEMATICS)


def test_the_package_neither_prints_nor_logs():
    logs = offenders(lambda _, name: name.startswith("logging"), PACKAGE)
    # That silences the logs of Dask.
    assert logs == ["nadia_balance/sweep/run_trial.py: logging"]
    nodes = ((p, ast.walk(source_files.syntax_tree(p))) for p in PACKAGE)
    names = ((p, getattr(node, "id", "")) for p, all_ in nodes for node in all_)
    assert not [path for path, name in names if name == "print"]


def test_every_module_has_the_tests_of_its_name():
    """Each __init__ is empty, and has none.  A LeafSystem has its own."""
    folders = ("core", "engines", "view")
    modules = python_files(*(f"nadia_balance/{name}" for name in folders))
    tests = {
        path: ROOT.joinpath("tests", *path.parts[1:-1], f"test_{path.name}")
        for path in modules
    }
    untested = [path for path, test in tests.items() if not test.exists()]
    assert {path.name for path in untested} == {"__init__.py"}
    assert not any(imported(path) for path in untested)
    systems = [
        node.name
        for path in python_files("nadia_balance/systems")
        for node in ast.walk(source_files.syntax_tree(path))
        if isinstance(node, ast.ClassDef)
        and {"LeafSystem", "Block"} & {*map(ast.unparse, node.bases)}
    ]
    systems.remove("Block")  # which is in test_ports.py
    assert "MomentumQp" in systems
    for name in systems:
        words = re.sub("(?<=[a-z])(?=[A-Z])", "_", name).lower()
        assert (ROOT / "tests" / "systems" / f"test_{words}.py").exists()


def test_no_meshcat_listens_on_all_interfaces():
    """Meshcat() without parameters does, and strangers see, and click."""
    open_to_all = ("StartMeshcat(", " Meshcat()")
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    code = [ROOT / path for path in (*RUNTIME, *python_files("docs"))]
    assert not [
        path
        for path in (*pages, *code)
        if any(call in path.read_text("utf-8") for call in open_to_all)
    ]
