"""What is simulated: robot, walking command, pushes, all parameters."""

import math
from dataclasses import dataclass, field
from pathlib import Path

from pydrake.common.yaml import yaml_load_file
from pydrake.multibody.plant import MultibodyPlantConfig

from nadia_balance.capture_point_controller import ControllerParams
from nadia_balance.core.gait import Gait
from nadia_balance.core.push import Push
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.typed_yaml import load_typed

SCENARIO_FOLDER = Path(__file__).parent / "scenarios"
MECHANISMS = ("icp_only",)


def default_plant_config() -> MultibodyPlantConfig:
    """Point contact at 1 kHz: exact enough, and the fastest that is."""
    return MultibodyPlantConfig(
        time_step=0.001,
        contact_model="point",
        discrete_contact_approximation="sap",
    )


@dataclass(kw_only=True)
class Scenario:
    """One run: the same scenario and seed give the same bits."""

    description: str = ""  # a line for the user
    robot: str = "nadia"  # a folder of models, or a robot.yaml
    duration: float = 10.0  # [s]
    seed: int = 0  # 0: exact start; else shifts it by up to 10 um
    mechanisms: str = "icp_only"  # what may be used to recover
    plant_config: MultibodyPlantConfig = field(
        default_factory=default_plant_config
    )
    gait: Gait = field(default_factory=Gait)
    reachability: ReachabilityParams = field(default_factory=ReachabilityParams)
    controller: ControllerParams = field(default_factory=ControllerParams)
    pushes: list[Push] = field(default_factory=list)

    def validate(self) -> None:
        """Raises ValueError naming the field, its value, what is allowed."""
        if not (math.isfinite(self.duration) and self.duration > 0.0):
            raise ValueError(f"duration = {self.duration}: must be > 0 s")
        if self.seed < 0:
            raise ValueError(f"seed = {self.seed}: must be >= 0")
        if self.mechanisms not in MECHANISMS:
            raise ValueError(
                f"mechanisms = {self.mechanisms!r}: must be one of "
                f"{', '.join(MECHANISMS)}"
            )
        self._validate_periods()
        self.gait.validate()
        self.reachability.validate()
        self.controller.validate()
        for push in self.pushes:
            push.validate()

    def _validate_periods(self) -> None:
        step = self.plant_config.time_step
        ticks = self.controller.control_period / step if step > 0 else 0.0
        if not 0.0 < step or abs(ticks - round(ticks)) > 1e-9 or ticks < 1:
            raise ValueError(
                f"time_step = {step}: must be > 0 and divide "
                f"control_period = {self.controller.control_period} s"
            )


def scenario_names() -> dict[str, Path]:
    """The scenarios that come with the package, by name."""
    return {
        name: path
        for path in sorted(SCENARIO_FOLDER.glob("*.yaml"))
        for name in yaml_load_file(str(path))
    }


def load_scenario(
    name: str, filename: str | Path | None = None, text: str | None = None
) -> Scenario:
    """Returns the scenario `name` of the package, or of the file.

    `text` is YAML that overrides single fields.

    Raises:
        ValueError: unknown name or field, malformed YAML, a value out of
            range; the message names it.
        FileNotFoundError: there is no such file.
    """
    if filename is None:
        known = scenario_names()
        if name not in known:
            raise ValueError(
                f"scenario_name = {name!r}: must be one of {', '.join(known)}"
            )
        filename = known[name]
    elif not Path(filename).is_file():
        raise FileNotFoundError(f"scenario_file = {filename}: no such file")
    scenario = load_typed(
        Scenario, "scenario", filename=str(filename), child_name=name
    )
    if text:
        scenario = load_typed(
            Scenario, "scenario_text", data=text, defaults=scenario
        )
    scenario.validate()
    return scenario
