"""Balance control for walking humanoids, on Drake.

The public names are available here.  Each is imported at its first use, so that
who needs only `nadia_balance.core` does not import the rest; type checkers and
editors read the imports below.
"""

import importlib
import re
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nadia_balance.balance_controller import (
        BalanceController as BalanceController,
    )
    from nadia_balance.balance_controller import (
        CapturePointController as CapturePointController,
    )
    from nadia_balance.balance_controller import (
        ControllerParams as ControllerParams,
    )
    from nadia_balance.balance_controller import (
        controller_params as controller_params,
    )
    from nadia_balance.core.body.ground import Ground as Ground
    from nadia_balance.core.body.ground import Region as Region
    from nadia_balance.core.body.model import PointMassModel as PointMassModel
    from nadia_balance.core.math.daqp_solver import DaqpSolver as DaqpSolver
    from nadia_balance.core.plan.footstep_plan import (
        FootstepPlannerParams as FootstepPlannerParams,
    )
    from nadia_balance.core.plan.gait import Gait as Gait
    from nadia_balance.core.plan.gait import StepVector as StepVector
    from nadia_balance.core.plan.gait import walking_start as walking_start
    from nadia_balance.core.plan.waypoints import Waypoint as Waypoint
    from nadia_balance.core.walking.mechanisms import MECHANISMS as MECHANISMS
    from nadia_balance.core.walking.mechanisms import Mechanisms as Mechanisms
    from nadia_balance.core.walking.push import Push as Push
    from nadia_balance.core.walking.state import Adjustment as Adjustment
    from nadia_balance.core.walking.state import FootPose as FootPose
    from nadia_balance.core.walking.state import FootPoses as FootPoses
    from nadia_balance.core.walking.state import Footstep as Footstep
    from nadia_balance.core.walking.state import Phase as Phase
    from nadia_balance.core.walking.state import Side as Side
    from nadia_balance.core.walking.state import WalkingState as WalkingState
    from nadia_balance.core.whole_body.tasks import Motion as Motion
    from nadia_balance.core.whole_body.tasks import Task as Task
    from nadia_balance.diagrams.humanoid import (
        HumanoidDiagram as HumanoidDiagram,
    )
    from nadia_balance.diagrams.scenario import Command as Command
    from nadia_balance.diagrams.scenario import Scenario as Scenario
    from nadia_balance.diagrams.scenario import load_scenario as load_scenario
    from nadia_balance.diagrams.simulation import simulate as simulate
    from nadia_balance.engines.plants import MujocoPlant as MujocoPlant
    from nadia_balance.engines.plants import PointMassPlant as PointMassPlant
    from nadia_balance.engines.plants import (
        add_mujoco_plant as add_mujoco_plant,
    )
    from nadia_balance.policy.controller import (
        PolicyController as PolicyController,
    )
    from nadia_balance.policy.params import PolicyParams as PolicyParams
    from nadia_balance.robot.model import RobotModel as RobotModel
    from nadia_balance.robot.model import load_robot as load_robot
    from nadia_balance.robot.plants import add_ground as add_ground
    from nadia_balance.sweep.envelope import envelope as envelope
    from nadia_balance.systems.contact_clock import ContactClock as ContactClock
    from nadia_balance.systems.estimation import Imu as Imu
    from nadia_balance.systems.estimation import JointEncoders as JointEncoders
    from nadia_balance.systems.estimation import (
        StateEstimator as StateEstimator,
    )
    from nadia_balance.systems.feedback import (
        ComHeightController as ComHeightController,
    )
    from nadia_balance.systems.feedback import (
        IcpStepController as IcpStepController,
    )
    from nadia_balance.systems.feedback import MomentumQp as MomentumQp
    from nadia_balance.systems.foot_forces import (
        FootForceEstimator as FootForceEstimator,
    )
    from nadia_balance.systems.given_joints import GivenJoints as GivenJoints
    from nadia_balance.systems.given_joints import GivenMotion as GivenMotion
    from nadia_balance.systems.hardware import (
        FootForceSensor as FootForceSensor,
    )
    from nadia_balance.systems.hardware import Imperfections as Imperfections
    from nadia_balance.systems.hardware import JointDrives as JointDrives
    from nadia_balance.systems.hardware import StateSensor as StateSensor
    from nadia_balance.systems.plan import FixedFootsteps as FixedFootsteps
    from nadia_balance.systems.plan import FootstepPlanner as FootstepPlanner
    from nadia_balance.systems.plan import IcpPlanner as IcpPlanner
    from nadia_balance.systems.plan import TimingAdapter as TimingAdapter
    from nadia_balance.systems.plan import VelocityCommands as VelocityCommands
    from nadia_balance.systems.plan import (
        WalkingStateMachine as WalkingStateMachine,
    )
    from nadia_balance.systems.ports import NOTHING as NOTHING
    from nadia_balance.systems.push_source import PushSource as PushSource
    from nadia_balance.systems.state import (
        CentroidalEstimator as CentroidalEstimator,
    )
    from nadia_balance.systems.state import StatePredictor as StatePredictor
    from nadia_balance.systems.steps import (
        CaptureRegionStepAdjuster as CaptureRegionStepAdjuster,
    )
    from nadia_balance.systems.steps import SwingFootPlanner as SwingFootPlanner
    from nadia_balance.systems.waypoints import (
        WaypointFollower as WaypointFollower,
    )
    from nadia_balance.systems.whole_body import (
        FrictionEstimator as FrictionEstimator,
    )
    from nadia_balance.systems.whole_body import (
        WholeBodyInverseDynamics as WholeBodyInverseDynamics,
    )
    from nadia_balance.systems.wiring import connect as connect
    from nadia_balance.view.balance_visualizer import (
        BalanceVisualizer as BalanceVisualizer,
    )
    from nadia_balance.view.live_controls import LiveControls as LiveControls

    __version__: str

# Where each public name is, below `nadia_balance`; a test compares it with the
# imports above.
_MODULES = {
    "Adjustment": "core.walking.state",
    "BalanceController": "balance_controller",
    "BalanceVisualizer": "view.balance_visualizer",
    "CapturePointController": "balance_controller",
    "CaptureRegionStepAdjuster": "systems.steps",
    "CentroidalEstimator": "systems.state",
    "ComHeightController": "systems.feedback",
    "Command": "diagrams.scenario",
    "ContactClock": "systems.contact_clock",
    "ControllerParams": "balance_controller",
    "DaqpSolver": "core.math.daqp_solver",
    "FixedFootsteps": "systems.plan",
    "FootForceEstimator": "systems.foot_forces",
    "FootForceSensor": "systems.hardware",
    "FootPose": "core.walking.state",
    "FootPoses": "core.walking.state",
    "Footstep": "core.walking.state",
    "FootstepPlanner": "systems.plan",
    "FootstepPlannerParams": "core.plan.footstep_plan",
    "FrictionEstimator": "systems.whole_body",
    "Gait": "core.plan.gait",
    "GivenJoints": "systems.given_joints",
    "GivenMotion": "systems.given_joints",
    "Ground": "core.body.ground",
    "HumanoidDiagram": "diagrams.humanoid",
    "IcpPlanner": "systems.plan",
    "IcpStepController": "systems.feedback",
    "Imperfections": "systems.hardware",
    "Imu": "systems.estimation",
    "JointDrives": "systems.hardware",
    "JointEncoders": "systems.estimation",
    "LiveControls": "view.live_controls",
    "MECHANISMS": "core.walking.mechanisms",
    "Mechanisms": "core.walking.mechanisms",
    "MomentumQp": "systems.feedback",
    "Motion": "core.whole_body.tasks",
    "MujocoPlant": "engines.plants",
    "NOTHING": "systems.ports",
    "Phase": "core.walking.state",
    "PointMassModel": "core.body.model",
    "PointMassPlant": "engines.plants",
    "PolicyController": "policy.controller",
    "PolicyParams": "policy.params",
    "Push": "core.walking.push",
    "PushSource": "systems.push_source",
    "Region": "core.body.ground",
    "RobotModel": "robot.model",
    "Scenario": "diagrams.scenario",
    "Side": "core.walking.state",
    "StateEstimator": "systems.estimation",
    "StatePredictor": "systems.state",
    "StateSensor": "systems.hardware",
    "StepVector": "core.plan.gait",
    "SwingFootPlanner": "systems.steps",
    "Task": "core.whole_body.tasks",
    "TimingAdapter": "systems.plan",
    "VelocityCommands": "systems.plan",
    "WalkingState": "core.walking.state",
    "WalkingStateMachine": "systems.plan",
    "Waypoint": "core.plan.waypoints",
    "WaypointFollower": "systems.waypoints",
    "WholeBodyInverseDynamics": "systems.whole_body",
    "add_ground": "robot.plants",
    "add_mujoco_plant": "engines.plants",
    "connect": "systems.wiring",
    "controller_params": "balance_controller",
    "envelope": "sweep.envelope",
    "load_robot": "robot.model",
    "load_scenario": "diagrams.scenario",
    "simulate": "diagrams.simulation",
    "walking_start": "core.plan.gait",
}
__all__ = sorted(_MODULES)
# Older ones have other names, or need to be told which rows are equalities;
# a nightly of Drake is 0.0.date.
_LEAST = {"daqp": (0, 11), "drake": (1, 51)}


def _require_versions() -> None:
    """Refuses a package that is too old.

    Raises ImportError: one line that names it, its version and the least one.
    """
    for package, least in _LEAST.items():
        try:
            present = version(package)
        except PackageNotFoundError:  # built from its source
            continue
        major, minor, *_ = map(int, re.findall(r"\d+", f"{present}.0"))
        if (0, 0) < (major, minor) < least:
            raise ImportError(
                f"{package} = {present}: must be {least[0]}.{least[1]} or newer"
            )


_require_versions()


if not TYPE_CHECKING:  # who would accept any name, misspelt ones, too

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            module = importlib.import_module(f"{__name__}.results.versions")
            return module.versions()[__name__]
        if name not in _MODULES:
            raise AttributeError(
                f"module {__name__!r} has no attribute {name!r}"
            )
        module = importlib.import_module(f"{__name__}.{_MODULES[name]}")
        value = globals()[name] = getattr(module, name)
        return value


def __dir__() -> list[str]:
    return __all__
