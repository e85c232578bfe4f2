"""Largest push that any controller can recover from, for a sweep."""

import copy
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from nadia_balance.analysis.lipm_limit import LipmLimit
from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import walk_to_push
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts.envelope_sweep.protocols import Curves
from nadia_balance.scripts.envelope_sweep.search import Situation
from nadia_balance.scripts.envelope_sweep.trial import limit_from

AROUND = tuple(15.0 * i for i in range(24))  # directions of a picture [deg]


class References(NamedTuple):
    """Curves to compare limits with, in one situation; empty if unknown."""

    limit: Curves = {}  # of any controller, without angular momentum
    with_hips: Curves = {}  # of any controller, with angular momentum
    assumptions: str = ""  # of `limit`
    paper: Curves = {}


def limits_of(
    scenario: Scenario, situation: Situation, plant: str
) -> tuple[LipmLimit, LipmLimit]:
    """Returns the limits without and with the hips, before the push.

    The state is that of the point mass at the start of the push, the model that
    of `plant`: of the robot in the scenario's fidelity, or the simulated point
    mass.

    Raises:
        ValueError: the push is not within the walk.
    """
    scenario = copy.deepcopy(scenario)
    push = scenario.pushes[0]
    push.at, push.delta_v, push.force = situation.at, 0.0, None
    diagram = LipmDiagram(scenario)
    context, run = walk_to_push(diagram, scenario.duration, lambda _: False)
    if not run.until:
        raise ValueError(f"at = {push.at!r}: must be in the walk")
    robot = diagram.robot
    if plant == "humanoid":
        robot = load_robot(scenario.robot, scenario.fidelity)
    limit = limit_from(
        diagram, context, model=robot.point_mass, push_duration=push.duration
    )
    kappa = scenario.controller.balance.max_kappa
    return limit, replace(limit, kappa=kappa)


def physical_limits(
    robot: str,
    plant: str,
    situation: Situation,
    tried: Mapping[str, Iterable[float]],
    scenario_file: Path,
) -> References:
    """Returns the limits in the directions [deg] that each mechanisms tried.

    Those of the last mechanisms are also of AROUND.  The scenario is that of
    the file, or of the package without it.

    Raises:
        ValueError, OSError: the scenario or the robot does not exist any more.
    """
    file = scenario_file if scenario_file.is_file() else None
    scenario = load_scenario(situation.scenario, file, robot=robot)
    limits = limits_of(scenario, situation, plant)
    last = list(tried)[-1]
    directions = {
        name: {*angles, *(AROUND if name == last else ())}
        for name, angles in tried.items()
    }
    limit, with_hips = (_curves(one, directions) for one in limits)
    return References(limit, with_hips, limits[0].assumptions)


def _curves(limit: LipmLimit, directions: Mapping[str, set[float]]) -> Curves:
    return {
        name: {
            direction: one.largest_push(direction).delta_v
            for direction in sorted(angles)
        }
        for name, angles in directions.items()
        for one in [replace(limit, on=NAMED[name])]
    }


def limit_lines(
    scenario: Scenario,
    situation: Situation,
    plant: str,
    directions: Iterable[float],
) -> list[str]:
    """Returns a table of limits for the terminal, with their assumptions."""
    limits = limits_of(scenario, situation, plant)
    values = {
        f"{direction:g}": [
            limit.largest_push(direction).delta_v for limit in limits
        ]
        for direction in directions
    }
    columns = zip(*values.values(), strict=True)
    values["mean"] = [sum(column) / len(column) for column in columns]
    return [
        f"largest push that a point mass can recover from [m/s], {situation}, "
        f"{scenario.mechanisms}",
        "direction [deg]    CoP only    with momentum",
        *(f"{d:>15}  {a:10.2f}  {b:15.2f}" for d, (a, b) in values.items()),
        f"assumes {limits[-1].assumptions}",
        "",
    ]
