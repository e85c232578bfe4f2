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
    inside = path.parts[0] in ("nadia_balance", "tests")
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
