"""Imports go strictly downward, and the package keeps the rules of the house.

The oracle of every test here is the syntax tree of the source files; what is
compared are lists of offenders, which are empty.
"""

import ast
import sys
from pathlib import Path

from tests.source_files import (
    ROOT,
    imports,
    module_name,
    python_files,
    syntax_tree,
)

# Lowest first: a layer imports itself and those before it.
LAYERS = (
    "nadia_balance.core",
    "nadia_balance.new_robot",
    "nadia_balance.palette",
    "nadia_balance.typed_yaml",
    "nadia_balance.robot.params",
    "nadia_balance.robot.urdf",
    "nadia_balance.robot.ground_geometry",
    "nadia_balance.robot.checks",
    "nadia_balance.robot.model",
    "nadia_balance.robot.reach",
    "nadia_balance.robot.collision_avoidance",
    "nadia_balance.robot.kinematics",
    "nadia_balance.engines.mujoco_model",
    "nadia_balance.systems",
    "nadia_balance.capture_point_controller",
    "nadia_balance.balance_controller",
    "nadia_balance.analysis",
    "nadia_balance.results",
    "nadia_balance.diagrams",
    "nadia_balance.scripts",
    "tests",
)
PACKAGE = python_files("nadia_balance")
MATHEMATICS = python_files("nadia_balance/core", "nadia_balance/analysis")
RUNTIME = python_files("nadia_balance", "diagrams", "scripts")
IMPORTS = {path: set(imports(syntax_tree(path))) for path in RUNTIME}


def rank(module: str) -> int:
    """Number of the layer that holds `module`; -1 if it is in none."""
    for i, layer in enumerate(LAYERS):
        if f"{module}.".startswith(f"{layer}."):
            return i
    return -1


def calls(path: Path) -> set[str]:
    """The name of every function that is called by its plain name."""
    nodes = ast.walk(syntax_tree(path))
    functions = [node.func for node in nodes if isinstance(node, ast.Call)]
    return {f.id for f in functions if isinstance(f, ast.Name)}


def offenders(breaks_rule, paths=RUNTIME) -> list[str]:
    """Every import of `name` in a `path` that breaks a rule of both."""
    return [
        f"{path}: {name}"
        for path in paths
        for name in IMPORTS[path]
        if breaks_rule(path, name)
    ]


def test_every_file_is_in_a_layer():
    """But the front door, which is above none: it imports when it is asked."""
    outside = [path for path in RUNTIME if rank(module_name(path)) < 0]
    assert outside == [Path("nadia_balance/__init__.py")]
    assert Path("nadia_balance/core/walking/vocabulary.py") in PACKAGE


def test_imports_only_its_own_layer_and_those_below():
    assert not offenders(
        lambda path, name: rank(name) > rank(module_name(path))
    )


def test_nothing_is_imported_from_the_top_of_the_repository():
    """An installation has `nadia_balance` only: the rest is inside of it."""
    folders = ("diagrams", "models", "scripts", "tests")
    assert not offenders(lambda _, name: name.split(".")[0] in folders)


def test_core_and_analysis_are_pure_mathematics():
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


def test_imports_the_submodules_of_drake_that_it_needs():
    """`pydrake.all` takes 1.4 s to import."""
    assert not offenders(lambda _, name: name.startswith("pydrake.all"))


def test_the_package_neither_prints_nor_logs():
    assert not offenders(
        lambda _, name: name.split(".")[0] == "logging", PACKAGE
    )
    assert not [path for path in PACKAGE if "print" in calls(path)]


def test_names_the_solver_of_every_program():
    """Plain Solve() prefers licensed solvers: results would differ."""
    assert not offenders(lambda _, name: name == "pydrake.solvers.Solve")
    assert not [path for path in RUNTIME if "Solve" in calls(path)]
    assert not [p for p in RUNTIME if "solvers.Solve(" in p.read_text()]


def test_every_module_has_the_tests_of_its_name():
    """Each __init__ is empty, and has none."""
    folders = ("core", "analysis", "systems")
    modules = python_files(*(f"nadia_balance/{name}" for name in folders))
    untested = [
        path
        for path in modules
        if not (ROOT / f"tests/{path.parent.name}/test_{path.name}").exists()
    ]
    assert {path.name for path in untested} == {"__init__.py"}
    assert not any(IMPORTS[path] for path in untested)


def test_no_meshcat_listens_on_all_interfaces():
    """Meshcat() without parameters does, and strangers see, and click."""
    open_to_all = {"Meshcat()", "StartMeshcat()"}
    assert not [
        path
        for path in (*RUNTIME, *python_files("tests"))
        for node in ast.walk(syntax_tree(path))
        if isinstance(node, ast.Call) and ast.unparse(node) in open_to_all
    ]
