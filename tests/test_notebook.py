"""The notebook for learners runs as it is, in a kernel of its own."""

import ast

import nbformat
import pytest
from nbclient import NotebookClient

from tests import run_cache
from tests.run_cache import data
from tests.source_files import ROOT, imports

NOTEBOOK = ROOT / "docs" / "learning.ipynb"


@pytest.fixture(scope="module")
def told(tmp_path_factory) -> str:
    """All that its cells print; executed again if its code is another one."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    where = {"metadata": {"path": str(tmp_path_factory.mktemp("notebook"))}}

    def executed() -> str:
        NotebookClient(notebook, timeout=300, resources=where).execute()
        return printed(notebook)

    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    code = "\n".join(cell.source for cell in cells)
    modules = "docs.learning", *imports(ast.parse(code))
    return run_cache.once(modules, code + data(), executed)


def printed(notebook) -> str:
    return "".join(
        output.get("text", "")
        for cell in notebook.cells
        for output in cell.get("outputs", ())
    )


def test_tells_what_it_promises(told):
    """Oracle: its text: who recovers, and who does not."""
    alone, ours = told.split("with our adjuster")
    assert alone.count("RECOVERED") == 2  # the point mass, and Nadia
    assert alone.count("FELL") == 1  # with ankles and hips alone
    assert ours.count("RECOVERED") == 1


def test_what_is_stored_was_executed_and_is_small():
    """Oracle: each code cell has its number; 300 kB."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    numbers = [cell.execution_count for cell in code]
    assert numbers == list(range(1, len(code) + 1))
    assert printed(notebook).count("RECOVERED") == 3
    assert NOTEBOOK.stat().st_size < 300_000
