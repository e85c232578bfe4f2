"""What was simulated, and how many steps it takes to have recovered."""

import itertools

from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.log import Log, pushes, signal
from nadia_balance.results.summary import Run, RunInfo
from nadia_balance.robot import load_robot


def required_steps(scenario: Scenario, log: Log) -> tuple[int, int]:
    """Returns how many steps the last push requires, and how many of them fit.

    Required are the scenario's `required_steps`, or as many as the gait had
    left to take when the push began: none of a robot that only stands.  They
    fit between the push and the end of the run, each with its own transfer and
    swing, less one, since a push delays the steps: with fewer the robot has
    failed.  A run without a push is judged from its start.
    """
    robot = load_robot(scenario.robot, scenario.fidelity)
    start = scenario.start(scenario.point_mass(robot)).schedule
    begin, taken = 0.0, 0
    if felt := pushes(log):
        begin = felt[-1].start
        walking = signal(log, "walking_signal", felt[-1].first)
        taken = int(walking.steps_taken)
    left = start.footsteps[taken:]
    required = min(scenario.required_steps, len(left))
    ends = itertools.accumulate(
        (step.transfer_duration + step.swing_duration for step in left),
        initial=max(begin, start.duration),  # until then it stands
    )
    gait = scenario.gait
    last = scenario.duration - gait.transfer_duration - gait.swing_duration
    fitting = sum(end <= last + 1e-9 for end in itertools.islice(ends, 1, None))
    return required, min(required, fitting)


def run_info(
    scenario: Scenario, run: Run, plant: str = "humanoid", name: str = ""
) -> RunInfo:
    """Returns what to judge `run` by, a run of `scenario`.

    `plant` is humanoid or lipm, `name` that of the scenario.
    """
    push = scenario.pushes[0] if scenario.pushes else None
    required, fitting = required_steps(scenario, run.logs)
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
        required_steps=required,
        fitting_steps=fitting,
    )
