"""Imports go strictly downward, and the package keeps the rules of the house.

The oracle of every test here is the syntax tree of the source files.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.source_files import ROOT, imports, python_files, syntax_tree

# Lowest first: a layer imports itself and those before it.
LAYERS = (
    "nadia_balance.core",
    "nadia_balance.typed_yaml",
    "nadia_balance.robot_checks",
    "nadia_balance.robot",
    "nadia_balance.systems",
    "nadia_balance.capture_point_controller",
    "nadia_balance.balance_controller",
    "diagrams",
    "scripts",
    "tests",
)


def called_names(tree: ast.Module) -> Iterator[str]:
    """The name of every function that `tree` calls by its plain name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            yield node.func.id


def layer(module: str) -> int | None:
    """Rank of the layer that holds `module`; None if it is in none."""
    for rank, name in enumerate(LAYERS):
        if f"{module}.".startswith(f"{name}."):
            return rank
    return None


PACKAGE = python_files("nadia_balance")
CORE = python_files("nadia_balance/core")
RUNTIME = python_files("nadia_balance", "diagrams", "scripts")


def test_finds_the_files_that_it_judges():
    assert Path("nadia_balance/core/walking.py") in CORE
    assert set(CORE) < set(PACKAGE) < set(RUNTIME)


@pytest.mark.parametrize("path", RUNTIME, ids=str)
def test_imports_only_its_own_layer_and_those_below(path):
    rank = layer(".".join(path.with_suffix("").parts))
    if rank is None:  # nadia_balance/__init__.py: below everything
        assert path == Path("nadia_balance/__init__.py")
        rank = -1
    upward = [
        name
        for name in imports(syntax_tree(path))
        if (other := layer(name)) is not None and other > rank
    ]
    assert not upward


@pytest.mark.parametrize("path", CORE, ids=str)
def test_core_is_pure_mathematics(path):
    """Only the QP files know Drake, and of Drake only its solvers."""
    allowed = ("nadia_balance.core.", "numpy.")
    if "qp" in path.stem.split("_"):
        allowed += ("pydrake.solvers.",)
    assert not {
        name
        for name in imports(syntax_tree(path))
        if name.split(".")[0] not in sys.stdlib_module_names
        and not f"{name}.".startswith(allowed)
    }


@pytest.mark.parametrize("path", RUNTIME, ids=str)
def test_imports_the_submodules_of_drake_that_it_needs(path):
    """`pydrake.all` takes 1.4 s to import."""
    names = set(imports(syntax_tree(path)))
    assert not {n for n in names if n.startswith("pydrake.all")}


@pytest.mark.parametrize("path", PACKAGE, ids=str)
def test_the_package_neither_prints_nor_logs(path):
    tree = syntax_tree(path)
    assert "print" not in called_names(tree)
    assert not {n for n in imports(tree) if n.split(".")[0] == "logging"}


@pytest.mark.parametrize("path", RUNTIME, ids=str)
def test_names_the_solver_of_every_program(path):
    """Plain Solve() prefers licensed solvers: results would differ."""
    tree = syntax_tree(path)
    assert "Solve" not in called_names(tree)
    assert "pydrake.solvers.Solve" not in set(imports(tree))


@pytest.mark.parametrize(
    "path", python_files("nadia_balance/core", "nadia_balance/systems"), ids=str
)
def test_every_module_has_the_tests_of_its_name(path):
    if path.name == "__init__.py":
        assert not list(imports(syntax_tree(path))), "it re-exports names"
        return
    tests = ROOT / "tests" / path.parent.name / f"test_{path.name}"
    assert tests.is_file()
