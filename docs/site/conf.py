"""The site of these pages: `make site` builds it, offline.

Its source is the whole checkout, so that a link leads to the same place on the
site and where a page is read as Markdown.
"""

import sys
from pathlib import Path

from sphinx.application import Sphinx

import nadia_balance

sys.path.insert(0, str(Path(__file__).parent))
import api_pages
import docstrings
import pages

project = "nadia_balance"
author = "nadia_balance authors"
copyright = f"2026, {author}"
release = nadia_balance.__version__
root_doc = pages.GUIDE
include_patterns = ["*.md", "docs/**", "models/README.md"]
exclude_patterns = [
    ".*",
    "*.egg-info",
    "build",
    "diagrams",
    "dist",
    "docs/figures",
    "docs/publish",
    "envelopes",
    "nadia_balance",
    "runs",
    "scripts",
    "tests",
]
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]

smartquotes = False  # --flags stay what they are

html_theme = "furo"
html_title = f"nadia_balance {release}"
html_static_path = ["static"]
html_css_files = ["tables.css"]
html_extra_path = ["index.html", "../play.html"]
html_math_renderer = "mathml"
html_show_sourcelink = False

myst_heading_anchors = 4  # those that GitHub makes, too
myst_enable_extensions = ["dollarmath"]
nb_execution_mode = "off"  # `make results` has executed them
nb_merge_streams = True

default_role = "py:obj"  # `name` is code, and a link if there is such a name
add_module_names = False
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_use_type_comments = False  # there are none
napoleon_use_ivar = True
napoleon_use_rtype = False


def setup(app: Sphinx) -> None:
    """Adds what Sphinx lacks for these pages.

    Args:
        app: the build.
    """
    app.connect("builder-inited", api_pages.write)
    app.connect("source-read", pages.complete)
    # Before napoleon, whose priority is 500.
    app.connect("autodoc-process-docstring", docstrings.prepare, priority=400)
    app.add_directive("pydrake_system", docstrings.PydrakeSystem)
    math = (pages.math, None)
    app.add_html_math_renderer("mathml", math, math)
