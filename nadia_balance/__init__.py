"""Balance control for walking humanoids, on Drake.

The public names are available here; each is imported at its first use, so that
who needs only `nadia_balance.core` does not import the rest.
"""

import importlib

# `diagrams`, `models` and `scripts` are parts of this package; in a checkout
# they are links to the folders of the same names beside it.  In each line here:
# a module, and its public names.
_PUBLIC = """
    balance_controller BalanceController CapturePointController ControllerParams
    core.body.ground Ground Region
    core.body.model PointMassModel
    core.math.daqp_solver DaqpSolver
    core.plan.footstep_plan FootstepPlannerParams
    core.plan.gait Gait StepVector walking_start
    core.walking.push Push
    core.walking.vocabulary Adjustment FootPose FootPoses Footstep
    core.walking.vocabulary MECHANISMS Mechanisms Phase Side WalkingState
    core.whole_body.tasks Motion Task
    diagrams.humanoid HumanoidDiagram
    diagrams.scenario Command Scenario load_scenario
    diagrams.simulation simulate
    engines.plants MujocoPlant PointMassPlant add_mujoco_plant
    policy_controller PolicyController PolicyParams
    robot.model RobotModel load_robot
    robot.plants add_ground
    systems.estimation Imu JointEncoders StateEstimator
    systems.feedback ComHeightController IcpStepController MomentumQp
    systems.hardware FootForceSensor Imperfections JointDrives StateSensor
    systems.plan FixedFootsteps FootstepPlanner IcpPlanner TimingAdapter
    systems.plan VelocityCommands WalkingStateMachine
    systems.ports NOTHING
    systems.push_source ContactClock PushSource
    systems.signals connect
    systems.state CentroidalEstimator StatePredictor
    systems.steps CaptureRegionStepAdjuster SwingFootPlanner
    systems.whole_body FrictionEstimator WholeBodyInverseDynamics
    view.balance_visualizer BalanceVisualizer
    view.live_controls LiveControls
"""
_ROWS = map(str.split, _PUBLIC.strip().splitlines())
_HOME = {name: home for home, *names in _ROWS for name in names}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> object:
    if name == "__version__":
        summary = importlib.import_module(f"{__name__}.results.summary")
        return summary.versions()[__name__]
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = importlib.import_module(f"{__name__}.{_HOME[name]}")
    value = globals()[name] = getattr(module, name)
    return value


def __dir__() -> list[str]:
    return __all__
