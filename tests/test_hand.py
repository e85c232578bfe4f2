"""The hand of the code: no packed calls or empty words, docstrings in sections.

Oracle: the syntax tree (see tests/hand.py); offenders by file and line.
"""

import ast
from pathlib import Path

import pytest

from tests import hand

MOST_STATEMENTS = 18_192  # what there is: more has a reason
DENSEST = 0.52  # statements a line
SOURCES = hand.sources(*hand.FOLDERS)
FRONT_DOOR = Path("nadia_balance/__init__.py")


def offenders(rule, paths=SOURCES) -> list[str]:
    """What the rule finds in these files."""
    return [
        f"{path}:{finding}"
        for path in paths
        for finding in rule(ast.parse((hand.ROOT / path).read_text("utf-8")))
    ]


@pytest.mark.parametrize(
    "rule", [hand.splatted_packs, hand.empty_words, hand.missing_sections]
)
def test_nothing_is_found_in_the_package(rule):
    assert offenders(rule) == []


def test_an_init_file_has_a_docstring_and_nothing_else():
    """But the front door."""
    inits = [path for path in SOURCES if path.name == "__init__.py"]
    assert FRONT_DOOR in inits
    inits.remove(FRONT_DOOR)
    assert offenders(hand.logic, inits) == []


def test_the_budget_is_one_of_statements():
    """And these are not packed into lines."""
    trees = [(hand.ROOT / path).read_text("utf-8") for path in SOURCES]
    count = sum(hand.statements(ast.parse(text)) for text in trees)
    lines = sum(len(text.splitlines()) for text in trees)
    assert count <= MOST_STATEMENTS
    assert count / lines <= DENSEST


def test_the_rules_find_what_they_are_for():
    """Oracle: by hand, a line of each kind."""
    code = '''
def told(a, known=1):
    """Returns nothing of use."""
    of = a, known
    if known:
        raise ValueError
    return f(*of) + g(**{"way": 1})


class Block:
    def __init__(self, period: float):
        """Begins."""

    @property
    def size(self) -> int:
        """The size."""
'''
    tree = ast.parse(code)
    assert [one.partition(":")[0] for one in hand.splatted_packs(tree)] == ["4"]
    words = sorted(hand.empty_words(tree))
    assert words == ["2: known is a variable", "4: of is a variable"]
    assert list(hand.missing_sections(tree)) == [
        "2: told lacks Args",
        "2: told lacks Raises",
        "11: __init__ lacks Args",
    ]
    assert hand.statements(tree) == 11
