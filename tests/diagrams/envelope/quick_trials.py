"""Trials on the point mass that take no more than half a second."""

from pydrake.common.yaml import yaml_dump_typed

from diagrams.envelope.moment import Moment
from diagrams.envelope.sweep_plan import Cell
from diagrams.envelope.trial import trial_scenario
from diagrams.scenario import Scenario, load_scenario

PERIOD = 0.01  # of the point mass [s]
PUSH = "{delta_v: 0.0, phase: swing}"
ENDLESS = 10000.0  # a run that no test waits for the end of [s]


def stepping(duration: float = 3.5, push: str = PUSH) -> Scenario:
    """Steps in place; a step takes 1 s, after 0.5 s of standing."""
    steps = int(duration) + 1
    text = f"{{duration: {duration}, gait: {{num_steps: {steps}}}"
    return load_scenario("push", text=f"{text}, pushes: [{push}]}}")


def trial(
    delta_v: float = 0.3,
    *,
    direction: float = 120.0,
    mechanisms: str = "step",
    moment: str = "right swing 25 %",
    replica: int = 0,
    base: Scenario | None = None,
) -> Scenario:
    """The scenario of one trial."""
    cell = Cell(mechanisms, Moment.parse(moment), direction)
    return trial_scenario(base or stepping(), cell, delta_v, replica, PERIOD)


def text_of(scenario: Scenario) -> str:
    """As it travels."""
    return yaml_dump_typed(scenario)


def facts(row: dict) -> dict:
    """What does not depend on how busy the machine is."""
    return {name: value for name, value in row.items() if name != "cpu_s"}
