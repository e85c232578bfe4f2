"""What others recover from: the paper's robot, and the best that there can be.

Both are of one robot, stepping in place, at one moment.  Beside anything else
they would mislead.
"""

import csv
from dataclasses import dataclass, field

from diagrams.envelope.moment import Moment
from nadia_balance.robot import MODELS

Curve = dict[float, float]  # direction [deg] in [0, 360) -> velocity [m/s]

ROBOT = "nadia"
SCENARIO = "push"
MOMENT = Moment(phase="swing", side="right", fraction=0.25)


@dataclass(frozen=True, kw_only=True)
class References:
    """Curves by the name of the mechanisms; empty where there is none."""

    paper: dict[str, Curve] = field(default_factory=dict)  # Nadia, Fig. 10
    limit: dict[str, Curve] = field(default_factory=dict)  # of any controller

    def __bool__(self) -> bool:
        """True if there is something to compare with."""
        return bool(self.paper or self.limit)


def references(robot: str, scenario: str, moment: Moment) -> References:
    """Returns what a robot's pushes at a moment can be compared with."""
    if (robot, scenario, moment) != (ROBOT, SCENARIO, MOMENT):
        return References()
    return References(
        paper=_read("nadia_fig10.csv"), limit=_read("lipm_limit.csv")
    )


def _read(name: str) -> dict[str, Curve]:
    text = (MODELS / ROBOT / name).read_text(encoding="utf-8")
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    curves: dict[str, Curve] = {}
    for row in csv.DictReader(lines):
        direction = float(row.pop("direction"))
        for mechanisms, value in row.items():
            curves.setdefault(mechanisms, {})[direction] = float(value)
    return curves
