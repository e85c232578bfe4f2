"""What is simulated: robot, walking command, pushes, all parameters."""

import math
from dataclasses import dataclass, field
from pathlib import Path

from pydrake.common.yaml import yaml_load_file
from pydrake.multibody.plant import MultibodyPlantConfig

from diagrams.mechanisms import (
    AS_IN_PARAMETERS,
    MECHANISMS,
    with_mechanism,
)
from nadia_balance.capture_point_controller import ControllerParams
from nadia_balance.core.gait import Gait
from nadia_balance.core.push import Push
from nadia_balance.typed_yaml import load_typed

SCENARIO_FOLDER = Path(__file__).parent / "scenarios"
PLANT_WORDS = {  # of MultibodyPlantConfig
    "contact_model": ("point", "hydroelastic", "hydroelastic_with_fallback"),
    "discrete_contact_approximation": ("tamsi", "sap", "similar", "lagged"),
    "contact_surface_representation": ("triangle", "polygon"),
}


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
    required_steps: int = 0  # after a push, to have recovered from it [-]
    # Control period of the point mass.  It has the same largest pushes at
    # 0.01 as at the robot's, controller.control_period, but is faster. [s]
    lipm_period: float = 0.01
    plant_config: MultibodyPlantConfig = field(
        default_factory=default_plant_config
    )
    gait: Gait = field(default_factory=Gait)
    controller: ControllerParams = field(default_factory=ControllerParams)
    pushes: list[Push] = field(default_factory=list)

    def controller_params(self) -> ControllerParams:
        """The controller's parameters, with the mechanisms switched."""
        return with_mechanism(self.controller, self.mechanisms)

    def validate(self) -> None:
        """Raises ValueError naming the field, its value, what is allowed."""
        if self.seed < 0:
            raise ValueError(f"seed = {self.seed}: must be >= 0")
        if self.required_steps < 0:
            raise ValueError(
                f"required_steps = {self.required_steps}: must be >= 0"
            )
        if self.mechanisms not in (*MECHANISMS, AS_IN_PARAMETERS):
            raise ValueError(
                f"mechanisms = {self.mechanisms!r}: must be one of "
                f"{', '.join((*MECHANISMS, AS_IN_PARAMETERS))}"
            )
        if not 0.0005 <= self.lipm_period <= 0.02:
            raise ValueError(
                f"lipm_period = {self.lipm_period}: must be in [0.0005, 0.02] s"
            )
        self.controller.validate()
        _validate_plant(self.plant_config)
        self._validate_periods()
        self.gait.validate()
        for push in self.pushes:
            push.validate()
            self._validate_moment(push)

    def _validate_periods(self) -> None:
        step = self.plant_config.time_step
        ticks = self.controller.control_period / step
        if ticks < 1 or abs(ticks - round(ticks)) > 1e-9:
            raise ValueError(
                f"time_step = {step}: must divide "
                f"control_period = {self.controller.control_period} s"
            )
        period = self.controller.control_period
        if not period <= self.duration < math.inf:
            raise ValueError(
                f"duration = {self.duration}: must be finite and >= "
                f"control_period = {period} s"
            )

    def _validate_moment(self, push: Push) -> None:
        """Refuses a push of which it is known that it will never come."""
        gait = self.gait
        if push.time is not None and not push.time < self.duration:
            raise ValueError(
                f"time = {push.time}: must be < duration = {self.duration} s"
            )
        if push.phase and not (gait.num_steps or gait.steps or gait.footholds):
            raise ValueError(
                f"phase = {push.phase!r}: must come with steps in the gait"
            )


def _validate_plant(config: MultibodyPlantConfig) -> None:
    """Drake would refuse these late, and some by ending the process."""
    for name in ("time_step", "penetration_allowance", "stiction_tolerance"):
        value = getattr(config, name)
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} = {value}: must be finite and > 0")
    threshold = config.sap_near_rigid_threshold
    if not 0.0 <= threshold < math.inf:
        raise ValueError(
            f"sap_near_rigid_threshold = {threshold}: must be finite and >= 0"
        )
    for name, words in PLANT_WORDS.items():
        value = getattr(config, name)
        if value not in words:
            raise ValueError(
                f"{name} = {value!r}: must be one of {', '.join(words)}"
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
    what = f"scenario_file = {filename}"
    if filename is None:
        known = scenario_names()
        if name not in known:
            raise ValueError(
                f"scenario_name = {name!r}: must be one of {', '.join(known)}"
            )
        what, filename = "scenario", known[name]
    elif not Path(filename).is_file():
        raise FileNotFoundError(f"{what}: no such file")
    scenario = load_typed(Scenario, what, filename=filename, child_name=name)
    if text:
        scenario = load_typed(
            Scenario, "scenario_text", data=text, defaults=scenario
        )
    scenario.validate()
    return scenario
