"""Nobody else on the network gets to see, or to click, what is shown."""

import ast

from tests.source_files import python_files, syntax_tree


def test_no_meshcat_listens_on_all_interfaces():
    """Oracle: the source: Meshcat() without parameters listens on all."""
    folders = ("nadia_balance", "diagrams", "scripts", "tests")
    calls = [
        f"{path}:{node.lineno}"
        for path in python_files(*folders)
        for node in ast.walk(syntax_tree(path))
        if isinstance(node, ast.Call)
        and ast.unparse(node) in ("Meshcat()", "StartMeshcat()")
    ]
    assert calls == []
