"""Largest push that any controller can recover from, for a sweep."""

import copy
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from nadia_balance.analysis.lipm_limit import LipmLimit
from nadia_balance.core.mechanisms import NAMED
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import walk_to_push
from nadia_balance.robot import load_robot
from nadia_balance.scripts.envelope_sweep.limits import (
    Curves,
    Envelope,
    Physical,
)
from nadia_balance.scripts.envelope_sweep.search import Situation

AROUND = tuple(15.0 * i for i in range(24))  # directions of a picture [deg]


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
    push, controller = scenario.pushes[0], scenario.controller
    push.at, push.delta_v, push.force = situation.at, 0.0, None
    diagram = LipmDiagram(scenario)
    context, run = walk_to_push(diagram, scenario.duration, lambda _: False)
    state, icp, swing = (
        diagram.GetOutputPort(name).Eval(context)
        for name in ("walking_state", "icp", "swing_foot_reference")
    )
    if not run.until:
        raise ValueError(f"at = {push.at!r}: must be in the walk")
    robot = diagram.robot
    if plant == "humanoid":
        robot = load_robot(scenario.robot, scenario.fidelity)
    limit = LipmLimit(
        state=state,
        icp=icp,
        foot=swing[:2],
        model=robot.point_mass,
        timing=controller.timing_adapter,
        on=NAMED[scenario.mechanisms],
        push_duration=push.duration,
    )
    return limit, replace(limit, kappa=controller.balance.max_kappa)


def with_limits(envelope: Envelope, scenario_file: Path) -> Envelope:
    """Returns the envelope with the limits of any controller added.

    Scenarios are those of the file, or of the package without it; a situation
    whose scenario or robot does not exist any more gets no limits.
    """
    found = {}
    file = scenario_file if scenario_file.is_file() else None
    for situation in envelope.situations:
        try:
            scenario = load_scenario(
                situation.scenario, file, robot=envelope.robot
            )
            limits = limits_of(scenario, situation, envelope.plant)
        except (ValueError, OSError) as error:
            print(f"{situation}: no limit to compare with, {error}")
            continue
        found[situation] = _physical(*limits, situation, envelope)
    return replace(envelope, physical=found)


def _physical(
    limit: LipmLimit,
    with_hips: LipmLimit,
    situation: Situation,
    envelope: Envelope,
) -> Physical:
    """Limits in tried directions; with the last mechanisms also in AROUND."""
    tried = {
        name: set(envelope.curve(name, situation))
        for name in envelope.mechanisms
    }
    tried[envelope.mechanisms[-1]].update(AROUND)
    return Physical(
        limit=_curves(limit, tried),
        with_hips=_curves(with_hips, tried),
        assumptions=limit.assumptions,
    )


def _curves(limit: LipmLimit, directions: dict[str, Iterable[float]]) -> Curves:
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
