"""How the code is written: what a reader stumbles over, by its syntax tree.

python tests/hand.py [FOLDER ...]   # the findings, and the statements
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("nadia_balance", "diagrams", "scripts")

# As variables they say nothing: a noun of the field does.
EMPTY_WORDS = frozenset(
    {
        "found",
        "known",
        "most",
        "of",
        "own",
        "told",
        "wanted",
        "way",
        "what",
        "where",
        "why",
    }
)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
PACKS = (ast.Tuple, ast.List, ast.Dict, ast.Set)


def sources(*folders: str) -> list[Path]:
    """The Python files in these folders; no link is followed twice."""
    paths = {p.resolve() for f in folders for p in (ROOT / f).rglob("*.py")}
    return sorted(path.relative_to(ROOT) for path in paths)


def statements(tree: ast.AST) -> int:
    """The number of statements, docstrings and definitions included."""
    return sum(isinstance(node, ast.stmt) for node in ast.walk(tree))


def splatted_packs(tree: ast.AST) -> Iterator[str]:
    """Tuples, lists and dicts that are assigned only to be splatted."""
    scopes = [
        n for n in ast.walk(tree) if isinstance(n, (*FUNCTIONS, ast.Module))
    ]
    for scope in scopes:
        packed: dict[str, int] = {}
        splats, loads = {}, {}
        for node in _own_nodes(scope):
            if isinstance(node, ast.Assign | ast.AnnAssign) and _packs(
                node.value
            ):
                targets = getattr(node, "targets", None) or [node.target]
                for target in targets:
                    if isinstance(target, ast.Name):
                        packed.setdefault(target.id, node.lineno)
        for node in ast.walk(scope):
            splat = None
            if isinstance(node, ast.Call):
                starred = [
                    a.value for a in node.args if isinstance(a, ast.Starred)
                ]
                starred += [k.value for k in node.keywords if k.arg is None]
                for splat in starred:
                    if isinstance(splat, ast.Name):
                        splats[splat.id] = splats.get(splat.id, 0) + 1
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                loads[node.id] = loads.get(node.id, 0) + 1
        for name, line in packed.items():
            if splats.get(name) and splats[name] == loads.get(name):
                yield f"{line}: {name} is packed only to be splatted"


def _packs(value: ast.AST | None) -> bool:
    if isinstance(value, ast.BinOp):
        return _packs(value.left) or _packs(value.right)
    if isinstance(value, ast.Call):
        return isinstance(value.func, ast.Name) and value.func.id == "dict"
    return isinstance(value, PACKS)


def _own_nodes(scope: ast.AST) -> Iterator[ast.AST]:
    """The nodes of a scope without those of functions inside of it."""
    for node in ast.iter_child_nodes(scope):
        yield node
        if not isinstance(node, (*FUNCTIONS, ast.Lambda)):
            yield from _own_nodes(node)


def empty_words(tree: ast.AST) -> Iterator[str]:
    """Variables and arguments that are called by an empty word."""
    for node in ast.walk(tree):
        name = ""
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            name = node.id
        elif isinstance(node, ast.arg):
            name = node.arg
        elif isinstance(node, ast.alias):
            name = node.asname or ""
        if name.lstrip("_") in EMPTY_WORDS and not _is_field(node, tree):
            yield f"{node.lineno}: {name} is a variable"


def _is_field(node: ast.AST, tree: ast.AST) -> bool:
    classes = (n for n in ast.walk(tree) if isinstance(n, ast.ClassDef))
    return any(
        isinstance(part, ast.AnnAssign) and part.target is node
        for one in classes
        for part in one.body
    )


def logic(tree: ast.Module) -> Iterator[str]:
    """What an __init__.py has besides its docstring."""
    for node in tree.body:
        if not (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        ):
            yield f"{node.lineno}: logic in an __init__.py"


def missing_sections(tree: ast.Module) -> Iterator[str]:
    """Public functions without the sections that their signature asks for.

    Args, if there are any but self; Returns, or Yields, if it returns a value
    and is no property; Raises, if there is a raise in it.  A constructor's may
    stand in its class.
    """
    for function, owner in _public_functions(tree):
        text = ast.get_docstring(function) or ""
        if function.name == "__init__":
            text += ast.get_docstring(owner) or ""
        asked = []
        arguments = [*function.args.posonlyargs, *function.args.args]
        arguments += function.args.kwonlyargs
        names = [arg.arg for arg in arguments]
        names += [
            arg.arg
            for arg in (function.args.vararg, function.args.kwarg)
            if arg is not None
        ]
        decorators = {ast.unparse(one) for one in function.decorator_list}
        if owner is not None and "staticmethod" not in decorators:
            names = names[1:]
        if names:
            asked.append("Args")
        nothing = (None, "None", "NoReturn")
        returned = function.returns and ast.unparse(function.returns)
        is_property = any("property" in one for one in decorators)
        if returned not in nothing and not is_property:
            asked.append("Returns")
        if any(isinstance(node, ast.Raise) for node in _own_nodes(function)):
            asked.append("Raises")
        for section in asked:
            allowed = "Returns|Yields" if section == "Returns" else section
            if not re.search(rf"^\s*({allowed}):$", text, re.MULTILINE):
                yield f"{function.lineno}: {function.name} lacks {section}"


def _public_functions(
    tree: ast.Module,
) -> Iterator[tuple[ast.FunctionDef, ast.ClassDef | None]]:
    for node in tree.body:
        if isinstance(node, FUNCTIONS) and not node.name.startswith("_"):
            yield node, None
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for part in node.body:
                if isinstance(part, FUNCTIONS) and (
                    not part.name.startswith("_") or part.name == "__init__"
                ):
                    yield part, node


def main(*folders: str) -> None:
    """Prints the findings in these folders, by file and line."""
    count = lines = 0
    for path in sources(*(folders or FOLDERS)):
        text = (ROOT / path).read_text(encoding="utf-8")
        tree = ast.parse(text)
        count += statements(tree)
        lines += len(text.splitlines())
        findings = [*splatted_packs(tree), *empty_words(tree)]
        findings += missing_sections(tree)
        if path.name == "__init__.py" and path != Path(
            "nadia_balance/__init__.py"
        ):
            findings += logic(tree)
        for finding in findings:
            print(f"{path}:{finding}")
    print(f"{count} statements in {lines} lines, {count / lines:.3f} a line")


if __name__ == "__main__":
    main(*sys.argv[1:])
