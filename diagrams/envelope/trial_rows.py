"""A finished trial as a line of comma-separated values, and back."""

import csv
import io
from collections.abc import Iterable, Sequence

from diagrams.mechanisms import MECHANISMS

KEY = ("mechanisms", "phase", "direction_deg", "delta_v", "replica")
RESULTS = (
    *("outcome", "reason", "steps_after_push", "max_icp_error_m"),
    *("max_torque_ratio", "max_joint_speed", "qp_failures"),
    *("predicted_at_push", "predicted_at_touchdowns"),
)
_COMMON = (  # the same in all rows of a file
    *("robot", "scenario", "plant", "parameters", "code"),
    *("nadia_balance", "drake", "numpy", "python"),
)
COLUMNS = (*KEY, "seed", *RESULTS, *_COMMON)
# Not among them, since a trial has the same row whenever it is run.
COST_COLUMNS = (*KEY, "cpu_s", "wall_s")
_WHOLE = (
    *("replica", "seed", "steps_after_push", "qp_failures"),
    "predicted_at_push",
)
_REAL = (
    *("direction_deg", "delta_v", "max_icp_error_m"),
    *("max_torque_ratio", "max_joint_speed"),
)
_TYPES = {**dict.fromkeys(_WHOLE, int), **dict.fromkeys(_REAL, float)}

Key = tuple[str, str, float, float, int]  # the values of KEY


def key_of(row: dict) -> Key:
    """What no two rows share."""
    return tuple(row[name] for name in KEY)


def sort_key(row: dict) -> tuple:
    """By mechanisms, fewer before more, then by the rest of the key."""
    mechanisms, *rest = key_of(row)
    return list(MECHANISMS).index(mechanisms), *rest


def line_of(row: dict, columns: Sequence[str] = COLUMNS) -> str:
    """Returns `row` as one line; what it has not is empty.

    Numbers lose no digit; line breaks become spaces, lists "1;2;3".
    """
    return csv_line(_text(row.get(name)) for name in columns)


def csv_line(cells: Iterable[str]) -> str:
    """Returns the cells as one line, with its end."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerow(cells)
    return buffer.getvalue()


def parse_cells(cells: Sequence[str]) -> dict:
    """Returns the row of these cells; None where a number is not known.

    Raises:
        ValueError: too few or too many, or one is no number; it is named.
    """
    if len(cells) != len(COLUMNS):
        raise ValueError(f"must have {len(COLUMNS)} cells, has {len(cells)}")
    row: dict = {}
    for name, text in zip(COLUMNS, cells, strict=True):
        kind = _TYPES.get(name, str)
        try:
            row[name] = kind(text) if text or kind is str else None
        except ValueError:
            raise ValueError(f"{name} = {text!r}: must be a number") from None
    return row


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, (list, tuple)):
        return ";".join(map(_text, value))
    return " ".join(str(value).split())
