"""The notebook for learners runs as it is, cell after cell."""

import ast
import contextlib
import io
import json

from matplotlib import pyplot

from tests import run_cache
from tests.run_cache import data
from tests.source_files import ROOT, imports

NOTEBOOK = ROOT / "docs" / "learning.ipynb"
CELLS = [
    cell
    for cell in json.loads(NOTEBOOK.read_text("utf-8"))["cells"]
    if cell["cell_type"] == "code"
]


def test_tells_what_it_promises():
    """Oracle: its text: who recovers, and who does not."""
    code = "\n".join("".join(cell["source"]) for cell in CELLS)

    def printed() -> str:
        said = io.StringIO()
        with contextlib.redirect_stdout(said), pyplot.rc_context():
            exec(code, {})
        pyplot.close("all")
        return said.getvalue()

    modules = "docs.learning", *imports(ast.parse(code))
    told = run_cache.once(modules, code + data(), printed)
    alone, ours = told.split("with our adjuster")
    assert alone.count("RECOVERED") == 2  # the point mass, and Nadia
    assert alone.count("FELL") == 1  # with ankles and hips alone
    assert ours.count("RECOVERED") == 1


def test_what_is_stored_was_executed_and_is_small():
    """Oracle: each code cell has its number; 300 kB."""
    numbers = [cell["execution_count"] for cell in CELLS]
    assert numbers == list(range(1, len(CELLS) + 1))
    assert json.dumps(CELLS).count("RECOVERED in") == 3
    assert NOTEBOOK.stat().st_size < 300_000
