"""Docstrings as Sphinx reads them: their formulas, Drake's table of ports."""

import re
from typing import Any

import yaml
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

# An indented block behind an empty line that follows no section or directive.
_FORMULA = re.compile(
    r"(?<!:\n)^(?!\.\.|[A-Z]\w+:$)(\S.*\n)\n(?=    )", re.MULTILINE
)


def prepare(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]
) -> None:
    """Marks formulas as literal; `|x|` and `x_` as what they are in others.

    Args:
        app: the build.
        what: kind of the object.
        name: its full name.
        obj: itself.
        options: of autodoc.
        lines: of the docstring, which are changed.
    """
    if lines and lines[0].startswith("Alias for field number"):
        lines[:] = []  # Python's own, of a NamedTuple
    text = _FORMULA.sub(r"\1\n::\n\n", "\n".join(lines))
    is_literal = False
    lines[:] = []
    for line in text.split("\n"):
        if line and not line.startswith("    "):
            is_literal = line == "::"
        escaped = re.sub(r"\||_(?=\W|$)", r"\\\g<0>", line)
        lines.append(line if is_literal else escaped)


class PydrakeSystem(SphinxDirective):
    """The ports of a system, in the way in which Drake tells them."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Makes two lines.

        Returns:
            The inputs and the outputs.
        """
        ports = yaml.safe_load("\n".join(self.content))
        fields = nodes.field_list()
        for key, title in (
            ("input_ports", "Inputs"),
            ("output_ports", "Outputs"),
        ):
            body = nodes.paragraph()
            for i, port in enumerate(ports.get(key) or ["none"]):
                body += nodes.Text(", " if i else "")
                body += nodes.literal("", port)
            fields += nodes.field(
                "", nodes.field_name("", title), nodes.field_body("", body)
            )
        return [fields]
