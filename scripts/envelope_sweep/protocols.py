"""The papers' figures of the largest pushes: protocols and results."""

import csv
from dataclasses import dataclass

from nadia_balance.core.walking.mechanisms import ATLAS_MECHANISMS, MECHANISMS
from nadia_balance.robot.model import MODELS
from nadia_balance.scripts.envelope_sweep.search import Situation

Curve = dict[float, float]  # direction [deg] in [0, 360) -> velocity [m/s]
Curves = dict[str, Curve]  # by the name of the mechanisms

G = 9.81  # [m/s^2]


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """A figure of a paper, with the conditions as flags of a sweep."""

    robot: str
    scenario_name: str  # of every gait
    at: str
    directions: str
    mechanisms: str
    paper: str  # name of its curves
    figures: str  # CSV in the robot's folder, in `unit`
    unit: str = "m/s"
    unit_speed: float = 1.0  # velocity change of the CoM per `unit` [m/s]

    def curves(self, scenario: str) -> Curves:
        """The curves [m/s] of a gait."""
        path = MODELS / self.robot / self.figures
        text = path.read_text(encoding="utf-8")
        lines = (line for line in text.splitlines() if not line.startswith("#"))
        curves: Curves = {}
        for row in csv.DictReader(lines):
            if row.pop("scenario", scenario) != scenario:
                continue
            direction = float(row.pop("direction"))
            for mechanisms, value in row.items():
                curve = curves.setdefault(mechanisms, {})
                curve[direction] = float(value) * self.unit_speed
        return curves


PROTOCOLS = {
    "nadia_fig10": Protocol(
        robot="nadia",
        scenario_name="push",
        at="right swing 25 %",
        directions="12",
        mechanisms=",".join(MECHANISMS),
        paper="the Nadia paper's, Fig. 10",
        figures="nadia_fig10.csv",
    ),
    "atlas_fig6": Protocol(
        robot="atlas",
        scenario_name="atlas_forward_fast,atlas_forward_slow,"
        "atlas_in_place_fast,atlas_in_place_slow",
        at="right swing 50 %",
        directions="0,30,45,90,135,150,180,210,225,240,270,300,315,330",
        mechanisms=",".join(ATLAS_MECHANISMS),
        paper="the Atlas paper's, Fig. 6",
        figures="atlas_fig6.csv",
        unit="weight",
        unit_speed=0.1 * G,  # a force for 0.1 s
    ),
}


def protocol_of(robot: str, situation: Situation) -> Protocol | None:
    """Returns the figure with this `robot` and `situation`, if any."""
    for figure in PROTOCOLS.values():
        if (robot, situation.at) == (figure.robot, figure.at):
            if situation.scenario in figure.scenario_name.split(","):
                return figure
    return None
