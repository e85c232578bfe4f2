"""docs/papers.md has all that is in the papers, and names what there is."""

import ast
import importlib
import re

import pytest

from tests.source_files import ROOT, python_files, syntax_tree

PAGE = (ROOT / "docs" / "papers.md").read_text("utf-8")
# What is ours: an idea, and where it is.
OURS = re.findall(r"^\| ([^|]+) \| ([^|]+) \|$", PAGE, re.MULTILINE)
NADIA, ATLAS = (
    [  # the first words of a row, such as `Eq. 1` or `Sec. V, the three rules`
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in part.splitlines()
        if re.match(r"\| (Eq|Fig|Alg|Sec)", line)
    ]
    for part in PAGE.split("\n## ")[1:]
)
ROWS = [*NADIA, *ATLAS]


@pytest.mark.parametrize(
    ("rows", "most"), [(NADIA, (16, 0, 14)), (ATLAS, (22, 1, 8))]
)
def test_every_number_of_a_paper_has_its_row(rows, most):
    """Oracle: the last numbers in print; each row has four cells."""
    numbers = zip(("Eq.", "Algorithm", "Fig."), most, strict=True)
    printed = [f"{kind} {n + 1}" for kind, last in numbers for n in range(last)]
    found = [row[0] for row in rows if not row[0].startswith("Sec.")]
    assert found == printed
    assert {len(row) for row in rows} == {4}


def import_name(name: str):
    """What the page names, such as `core.math.lipm.icp`."""
    *modules, last = name.split(".")
    inner = [last]
    if modules[-1][0].isupper():  # a method
        inner.insert(0, modules.pop())
    top = [] if modules[0] == "docs" else ["nadia_balance"]
    thing = importlib.import_module(".".join([*top, *modules]))
    for part in inner:
        thing = getattr(thing, part)
    return thing


def test_every_function_can_be_imported():
    """Oracle: Python; one that is not there has a reason."""
    for number, names, tests, why in ROWS:
        found = re.findall(r"`([\w.]+)`", names)
        assert found or why, number
        assert bool(found) == bool(tests), number
        for name in [*found, *re.findall(r"`(\w+\.[\w.]+)`", why)]:
            assert import_name(name)


def test_what_is_ours_is_there():
    """Oracle: Python; an idea has one place or more, all of them in full."""
    (_, *ideas) = (row for row in OURS if not row[0].startswith("-"))
    assert len(ideas) > 10
    for idea, names in ideas:
        found = names.strip("`").split("`, `")
        assert all(import_name(name) for name in found), idea


def test_every_test_is_one():
    """Oracle: the functions of the files."""
    known = {
        f"{path}::{node.name}"
        for path in python_files("tests")
        for node in ast.walk(syntax_tree(path))
        if isinstance(node, ast.FunctionDef)
    }
    named = {name for row in ROWS for name in re.findall(r"`([^`]+)`", row[2])}
    assert named <= known
