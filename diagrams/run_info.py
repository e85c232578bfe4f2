"""What a summary says of a run beside its log."""

from diagrams.required_steps import required_steps
from diagrams.scenario import Scenario
from diagrams.simulation import Run
from diagrams.summary import RunInfo


def run_info(
    scenario: Scenario, run: Run, plant: str = "humanoid", name: str = ""
) -> RunInfo:
    """Returns what to judge `run` by, a run of `scenario`.

    `plant` is humanoid or lipm, `name` that of the scenario.
    """
    push = scenario.pushes[0] if scenario.pushes else None
    required, wanted = required_steps(scenario, run.logs)
    return RunInfo(
        robot=scenario.robot,
        mechanisms=scenario.mechanisms,
        scenario=name,
        plant=plant,
        seed=scenario.seed,
        direction_deg=push.direction_deg if push else None,
        delta_v=push.delta_v if push else None,
        fell_at=run.fell_at,
        fall_reason=run.fall_reason,
        error=run.error,
        interrupted=run.interrupted,
        missed_pushes=run.missed_pushes,
        improper_contacts=run.improper_contacts,
        cpu_time=run.cpu_time,
        required_steps=required,
        wanted_steps=wanted,
    )
