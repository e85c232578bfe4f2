"""`import nadia_balance` gives what a user needs, and costs nothing itself."""

import ast
import importlib
import inspect
import pkgutil
import tomllib
from pathlib import Path

import jedi
import pytest
from pydrake.systems.framework import LeafSystem

import nadia_balance
from nadia_balance import engines, systems, view
from tests import source_files
from tests.scripts.running import ended, python
from tests.source_files import ROOT


def test_a_scenario_is_simulated_by_its_name():
    """Oracles: pyproject.toml; outward is to the right of a left stance."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        version = tomllib.load(file)["project"]["version"]
    assert nadia_balance.__version__ == version
    assert (ROOT / "nadia_balance" / "py.typed").exists()
    run = nadia_balance.simulate("push", 0.012, direction="outward", seed=3)
    assert (run.info.direction_deg, run.info.seed) == (270.0, 3)
    assert run.summary["outcome"] == "undecided"
    assert run.summary["scenario"] == "push"
    still = nadia_balance.simulate("walk_in_place", 0.0)
    assert (still.info.delta_v, still.summary["pushes"]) == (None, [])
    assert "array" not in repr(run)
    assert dir(nadia_balance) == nadia_balance.__all__
    with pytest.raises(AttributeError, match="no attribute 'walk'"):
        nadia_balance.walk  # noqa: B018
    for change in {"direction": "up"}, {"sed": 3}:
        with pytest.raises(ValueError, match=f"^{next(iter(change))}"):
            nadia_balance.simulate("push", **change)


def test_what_a_type_checker_sees_is_what_python_imports():
    """Oracle: the imports, as a type checker reads them."""
    tree = source_files.syntax_tree(Path("nadia_balance/__init__.py"))
    seen, _ = (node for node in tree.body if isinstance(node, ast.If))
    imports = {
        alias.name: line.module.removeprefix("nadia_balance.")
        for line in seen.body
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
        if alias.asname == alias.name  # is meant to be imported from here
    }
    assert imports == nadia_balance._MODULES


def test_an_editor_completes_what_a_run_has():
    """Oracle: jedi; for what mypy sees, see test_packaging."""
    code = "import nadia_balance as nb\nnb.simulate('push').summ"
    (completion,) = jedi.Script(code).complete()
    assert completion.name == "summary"


def test_all_leaf_systems_are_public():
    """Oracle: the classes in the modules of the rooms that have systems."""
    found = set()
    for room in engines, systems, view:
        for module in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            values = vars(importlib.import_module(module.name)).values()
            found |= {
                value.__name__
                for value in filter(inspect.isclass, values)
                if issubclass(value, LeafSystem)
                and value.__module__.startswith("nadia_balance.")
            }
    assert len(found) > 10
    found.remove("Block")  # the base of all others, which does nothing
    assert found <= set(nadia_balance.__all__)


def test_a_name_is_imported_when_it_is_used():
    """Oracle: the modules that Python has loaded after each line."""
    code = """
import sys
def loaded(*names): return [name for name in names if name in sys.modules]
import nadia_balance
assert not loaded("numpy", "pydrake")
from nadia_balance.core.math import polygon
from nadia_balance.core.walking import state
assert not loaded("pydrake")
from nadia_balance import *
assert loaded("pydrake.systems.framework")
"""
    done = ended(python("-c", code))
    assert done.code == 0, done.err
