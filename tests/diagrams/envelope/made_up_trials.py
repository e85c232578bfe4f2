"""Made-up sweeps whose limits are known, without simulating.

Each trial is recovered from if the push is no larger than the cell's limit.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict

from diagrams.envelope.envelope_data import Envelope, envelope_of
from diagrams.envelope.limit_search import SearchParams, next_batch
from diagrams.envelope.moment import Moment
from diagrams.envelope.references import MOMENT, SCENARIO, references

SEARCH = SearchParams()
Cell = tuple[str, Moment, float]  # mechanisms, moment, direction [deg]
Limits = Mapping[Cell, float]  # [m/s]
VERSIONS = {
    "nadia_balance": "0.1.0",
    "drake": "1.51.1",
    "numpy": "2.4.6",
    "python": "3.11.2",
}


def paper_times(factor: float, moment: Moment = MOMENT) -> dict:
    """The limits of the paper's robot at the reference moment, scaled."""
    paper = references("nadia", SCENARIO, MOMENT).paper
    return {
        (mechanisms, moment, direction): factor * value
        for mechanisms, curve in paper.items()
        for direction, value in curve.items()
    }


def read_table(text: str) -> list[dict[str, str]]:
    """The rows of a Markdown table, by the names of its columns."""
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.strip().splitlines()
    ]
    return [dict(zip(lines[0], row, strict=True)) for row in lines[2:]]


def identity_of(search: SearchParams = SEARCH, plant: str = "humanoid") -> dict:
    """What the first line of the file says."""
    return {
        "protocol": 1,
        "robot": "nadia",
        "scenario": "push",
        "plant": plant,
        **asdict(search),
        "seed": 0,
        "parameters": "0123456789abcdef",
        "code": "fedcba9876543210",
        **VERSIONS,
    }


def made_up_rows(
    limits: Limits,
    search: SearchParams = SEARCH,
    robot: str = "nadia",
    is_unfinished: Callable[[Cell], bool] = lambda _: False,
) -> list[dict]:
    """The rows of all trials that the search asks for, cell by cell.

    In a cell that `is_unfinished` the levels passed are not confirmed.
    """
    rows = []
    for cell, largest in limits.items():
        results: dict[tuple[int, int], bool] = {}
        while batch := next_batch(results, search):
            if is_unfinished(cell) and len(batch) > 1:
                break
            for level, replica in batch:
                delta_v = round(level * search.resolution, 9)
                recovered = delta_v <= largest + 1e-9
                results[level, replica] = recovered
                rows.append(_row(cell, delta_v, replica, recovered, robot))
    return rows


def made_up_envelope(
    limits: Limits, search: SearchParams = SEARCH, **options
) -> Envelope:
    """The envelope of the rows that made_up_rows gives."""
    rows = made_up_rows(limits, search, **options)
    return envelope_of(identity_of(search), rows)


def _row(
    cell: Cell | None,
    delta_v: float,
    replica: int,
    recovered: bool,
    robot: str,
) -> dict:
    mechanisms, moment, direction = cell or ("step", MOMENT, 0.0)
    upright = not recovered and round(100.0 * delta_v) % 3 == 0
    fell = "failed" if upright else "fell"
    return {
        "mechanisms": mechanisms,
        "phase": str(moment),
        "direction_deg": direction,
        "delta_v": delta_v,
        "replica": replica,
        "seed": replica,
        "outcome": "recovered" if recovered else fell,
        "reason": "" if recovered else "PELVIS_LINK - ground",
        "steps_after_push": 9 if recovered else 2,
        "max_icp_error_m": 0.125 * delta_v,
        "max_torque_ratio": 0.75,
        "max_joint_speed": 6.5,
        "qp_failures": 0,
        "predicted_at_push": 2 if recovered else -1,
        "predicted_at_touchdowns": "2;1;0;0" if recovered else "-1;-1",
        "robot": robot,
        "scenario": "push",
        "plant": "humanoid",
        "parameters": "0123456789abcdef",
        "code": "fedcba9876543210",
        **VERSIONS,
    }
