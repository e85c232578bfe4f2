"""What a page has only on the site: the sidebar, code of examples, formulas."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
GUIDE, RESULTS = "docs/index", "docs/results/README"
_EXAMPLE = re.compile(r"^\[.*\]\((\.\./examples/\w+\.py)\)$", re.MULTILINE)
_LINK = re.compile(r"\[([^\]]*)\]\(([\w./-]+)\)")
_HTML = re.compile(r"\[([^\]]*)\]\((?:docs/)?(\w+\.html)\)")
_ENTRY = re.compile(r"^- \[.*?\]\(([\w./]+)\.(?:md|ipynb)\)", re.MULTILINE)


def complete(app: Sphinx, page: str, text: list[str]) -> None:
    """Adds to a page what its Markdown cannot say.

    Args:
        app: the build.
        page: its path, without the suffix.
        text: one entry, which is changed.
    """
    if page == GUIDE:
        text[0] += "".join(sidebar(text[0]))
    if page == RESULTS:
        text[0] += toctree(
            "Tables", ["robots", "*/tables", "single/*/failures"]
        )
    folder = (ROOT / page).parent

    def unlinked(link: re.Match[str]) -> str:
        return link[1] if (folder / link[2]).is_dir() else link[0]

    top = "../" * page.count("/")
    text[0] = _HTML.sub(rf'<a href="{top}\2">\1</a>', text[0])
    text[0] = _LINK.sub(unlinked, text[0])
    text[0] = _EXAMPLE.sub(
        r"\g<0>\n\n```{literalinclude} \1\n:language: python\n```", text[0]
    )


def sidebar(text: str) -> Iterator[str]:
    """Makes the sidebar of the guide's headings, and of what they link.

    Args:
        text: of the guide.

    Yields:
        A table of contents for each heading.
    """
    for section in text.split("\n## ")[1:]:
        caption, _, rest = section.partition("\n")
        yield toctree(caption, _ENTRY.findall(rest))
    yield toctree("API", ["api/index"])


def toctree(caption: str, entries: Iterable[str]) -> str:
    """Makes a table of contents that only the sidebar shows.

    Args:
        caption: its heading.
        entries: the pages, or patterns of them.

    Returns:
        A directive.
    """
    options = ":hidden:", ":glob:", ":titlesonly:", f":caption: {caption}"
    lines = ("", "```{toctree}", *options, "", *entries, "```", "")
    return "\n".join(lines)


def math(translator: Any, node: nodes.math | nodes.math_block) -> None:
    """Writes a formula as MathML, which browsers draw without a script.

    Args:
        translator: writer of the page.
        node: the formula.
    """
    is_block = isinstance(node, nodes.math_block)
    translator.body.append(tex2mathml(node.astext(), as_block=is_block))
    raise nodes.SkipNode
