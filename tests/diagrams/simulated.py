"""Real runs that more than one test looks at: each is simulated once."""

import functools

from diagrams.humanoid import HumanoidDiagram
from diagrams.lipm import LipmDiagram
from diagrams.scenario import Scenario, load_scenario
from diagrams.simulation import Run, simulate
from diagrams.summary import RunInfo, summarize

DIAGRAMS = {"humanoid": HumanoidDiagram, "lipm": LipmDiagram}


def scenario_of(text: str = "{}") -> Scenario:
    """Stands, by ankles and hips alone, but for what the YAML says."""
    return load_scenario("stand", text=f"{{mechanisms: icp_only, {text[1:]}")


def diagram_of(text: str = "{}", plant: str = "humanoid"):
    """The closed loop of that scenario."""
    return DIAGRAMS[plant](scenario_of(text))


def simulated(text: str = "{}", plant: str = "humanoid") -> Run:
    """What comes out of that scenario; do not change it."""
    return _simulated(text, plant)


@functools.cache
def _simulated(text: str, plant: str) -> Run:
    diagram = diagram_of(text, plant)
    return simulate(diagram, diagram.scenario.duration)


def figures(text: str = "{}", plant: str = "humanoid") -> dict:
    """The summary of that scenario."""
    run = simulated(text, plant)
    info = RunInfo(
        robot="nadia",
        mechanisms="icp_only",
        fell_at=run.fell_at,
        fall_reason=run.fall_reason,
        cpu_time=run.cpu_time,
    )
    return summarize(run.logs, info)
