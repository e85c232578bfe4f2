"""The project's own source files, and what they import."""

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def python_files(*folders: str) -> list[Path]:
    """The Python files under these folders, relative to the root."""
    paths = (p for f in folders for p in (ROOT / f).rglob("*.py"))
    return sorted(path.relative_to(ROOT) for path in paths)


def module_name(path: Path) -> str:
    """The name by which the file at `path` is imported."""
    name = ".".join(path.with_suffix("").parts)
    inside = path.parts[0] in ("nadia_balance", "examples", "tests")
    return name if inside else f"nadia_balance.{name}"


@functools.cache
def syntax_tree(path: Path) -> ast.Module:
    return ast.parse((ROOT / path).read_text(encoding="utf-8"))


def imports(tree: ast.Module) -> Iterator[str]:
    """The full dotted name of everything imported anywhere in `tree`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: a relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@functools.cache
def module_files() -> dict[str, Path]:
    """The file of each of our modules, by the name of its import."""
    ours = python_files(
        "nadia_balance", "diagrams", "scripts", "examples", "tests"
    )
    files = {module_name(path).removesuffix(".__init__"): path for path in ours}
    return files | {path.stem: path for path in python_files("docs/figures")}


@functools.cache
def _imported(path: Path) -> set[Path]:
    """The files of ours that the file at `path` imports."""
    files, found = module_files(), set()
    for name in imports(syntax_tree(path)):
        while name and name not in files:  # a name in a module
            name = name.rpartition(".")[0]
        found |= {files[name]} if name else set()
    return found


def reached(name: str) -> set[Path]:
    """The files of the module `name`, and of all of ours that it imports.

    Through others, too.  A package that is not imported itself is a docstring,
    or the front door: then it is not among them.
    """
    found, todo = set(), {module_files()[name]}
    while todo:
        found |= todo
        todo = set().union(*map(_imported, todo)) - found
    return found
