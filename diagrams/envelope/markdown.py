"""Tables in Markdown that can be read as plain text, too."""

from collections.abc import Sequence

NOTHING = "–"  # where there is no value


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Returns a table; the first column is aligned left, the others right."""
    lines = [
        [cell.replace("|", "\\|") for cell in line] for line in (head, *rows)
    ]
    widths = [max(3, *map(len, column)) for column in zip(*lines, strict=True)]
    text = [_line(line, widths) for line in lines]
    first, *others = (width + 1 for width in widths)
    rule = [f":{'-' * first}", *(f"{'-' * width}:" for width in others)]
    return "\n".join([text[0], f"|{'|'.join(rule)}|", *text[1:]]) + "\n"


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = cells
    padded = [first.ljust(widths[0])]
    padded += [c.rjust(w) for c, w in zip(others, widths[1:], strict=True)]
    return f"| {' | '.join(padded)} |"
