"""What was simulated, and what it takes to have recovered."""

import itertools

from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.log import Log, pushes, signal
from nadia_balance.results.summary import Run, RunInfo
from nadia_balance.robot import load_robot

PATIENCE = 8  # steps after the last push: so many a recovery may take


def required_calm_steps(scenario: Scenario, log: Log) -> tuple[int, bool]:
    """Returns the calm steps that are required, and whether it ran long enough.

    Required are the scenario's `calm_steps`, as far as the gait had so many
    left when the last push began: none of a robot that only stands.  A run is
    long enough if PATIENCE steps, or all that are left, fit between the push
    and its end, each with its own transfer and swing, less one, since a push
    delays the steps.  A run without a push is judged from its start.
    """
    robot = load_robot(scenario.robot, scenario.fidelity)
    start = scenario.start(scenario.point_mass(robot)).schedule
    begin, taken = 0.0, 0
    if felt := pushes(log):
        begin = felt[-1].start
        walking = signal(log, "walking_signal", felt[-1].first)
        taken = int(walking.steps_taken)
    left = start.footsteps[taken:]
    required = min(scenario.calm_steps, max(len(left) - 1, 0))
    ends = itertools.accumulate(
        (step.transfer_duration + step.swing_duration for step in left),
        initial=max(begin, start.duration),  # until then it stands
    )
    gait = scenario.gait
    last = scenario.duration - gait.transfer_duration - gait.swing_duration
    fitting = sum(end <= last + 1e-9 for end in itertools.islice(ends, 1, None))
    return required, not required or fitting >= min(PATIENCE, len(left))


def run_info(
    scenario: Scenario, run: Run, plant: str = "humanoid", name: str = ""
) -> RunInfo:
    """Returns what to judge `run` by, a run of `scenario`.

    `plant` is humanoid or lipm, `name` that of the scenario.
    """
    push = scenario.pushes[0] if scenario.pushes else None
    calm_steps, is_long_enough = required_calm_steps(scenario, run.logs)
    upright = {}
    if scenario.fidelity == "realistic":
        upright["max_torso_tilt_deg"] = scenario.max_torso_tilt_deg
    return RunInfo(
        robot=scenario.robot,
        mechanisms=scenario.mechanisms,
        scenario=name,
        plant=plant,
        fidelity=scenario.fidelity,
        engine=scenario.engine,
        seed=scenario.seed,
        direction_deg=push.direction_deg if push else None,
        delta_v=push.delta_v if push else None,
        calm_steps=calm_steps,
        is_long_enough=is_long_enough,
        **upright,
    )
