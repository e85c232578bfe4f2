"""The controllers: alike in any harness, open to blocks of the user's."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

from nadia_balance.balance_controller import (
    BalanceController,
    CapturePointController,
    ControllerParams,
    controller_params,
)
from nadia_balance.core.feedback.icp_step_qp import IcpStepQpParams
from nadia_balance.core.steps.foothold_adjustment import current_adjustment
from nadia_balance.core.walking.state import FootPose, Phase
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.diagrams.simulation import simulate
from nadia_balance.robot.model import load_robot
from nadia_balance.systems.ports import declare_output, input_port
from nadia_balance.systems.signals import PHASES, PushSignal, WalkingSignal
from nadia_balance.view.scene import start_meshcat
from tests.blocks import answer, fix
from tests.diagrams.simulated import run_of, soon_pushed
from tests.example_walks import MODEL

PERIOD = 0.004


def test_stepped_by_hand_it_gives_the_recorded_torques():
    """Oracle: the log of a run with a push and a touchdown, bit for bit.

    Asked once more between two ticks, when the robot has moved on, it still
    gives the torques of the tick.
    """
    scenario = soon_pushed()
    robot, log = load_robot("nadia"), run_of(scenario).logs
    signal = WalkingSignal(log["walking_signal"].T)
    landed = np.flatnonzero(np.diff(signal.phase) < 0.0)
    assert [PHASES[int(signal.phase[i])] for i in landed] == [Phase.SWING]
    assert PushSignal(log["push_signal"].T).force.any()
    controller = BalanceController(
        scenario.controller, robot, start=scenario.start(robot.point_mass)
    )
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()

    def told(row):
        state, forces = log["state"][row], log["foot_forces"][row]
        fix(controller, context, estimated_state=state, foot_forces=forces)
        return answer(controller, context, "actuation").copy()

    for row, torques in enumerate(log["actuation"][:-1]):
        assert np.array_equal(told(row), torques), row
        simulator.AdvanceTo((row + 0.5) * PERIOD)
        assert np.array_equal(told(row + 1), torques), row
        simulator.AdvanceTo((row + 1) * PERIOD)


class Aside(LeafSystem):
    """A step adjuster of the user's: every step lands 6 cm further out."""

    def __init__(self, outputs=("adjustment",), **vectors):
        super().__init__()
        self._state = input_port(self, "walking_state")
        needs = {self._state.ticket()}
        for name in outputs:
            declare_output(self, name, self._calc, needs)
        for name, size in vectors.items():
            self.DeclareVectorInputPort(name, size)

    def _calc(self, context):
        now = current_adjustment(self._state(context))
        pose, side = now.nominal.pose, now.nominal.side
        further = pose.p_WF + [0.0, 0.06 * side.sign, 0.0]
        return replace(now, pose=FootPose(further, pose.yaw))


ATLAS = {"icp_step_qp": IcpStepQpParams()}


@pytest.mark.parametrize(
    ("params", "blocks", "message"),
    [
        ({"control_period": 0.0001}, {}, "control_period = 0.0001: must be in"),
        (
            {"icp_step_qp": IcpStepQpParams(num_steps=4)},
            {},
            "icp_step_qp.num_steps = 4: must be <= num_previewed_steps = 3",
        ),
        (
            {},
            {"icp_planner": Aside(())},
            "icp_planner = Aside: must have the o",
        ),
        (
            {},
            {"step_adjuster": Aside(wind=3)},
            "step_adjuster = Aside: input port 'wind' must be one of adjust",
        ),
        (ATLAS, {"step_adjuster": Aside()}, "block = 'step_adjuster': must be"),
        (ATLAS, {"momentum_qp": Aside()}, "block = 'momentum_qp': must be one"),
    ],
)
def test_refuses_parameters_and_blocks_that_do_not_fit(params, blocks, message):
    """Oracle: field or role, value or class, what is allowed."""
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        CapturePointController(ControllerParams(**params), MODEL, **blocks)


def test_whoever_lacks_a_walking_state_or_regions_is_drawn_and_told():
    """Oracle: runs that draw; one line that names port or moment."""

    class Limp(LeafSystem):
        def __init__(self, size=23):
            super().__init__()
            self.DeclareVectorInputPort("estimated_state", 59)
            self.DeclareVectorOutputPort(
                "actuation",
                size,
                lambda _, output: output.set_value(np.zeros(size)),
            )

    scenario = load_scenario("push_standing")
    for blocks in {"controller": Limp()}, {"step_adjuster": Aside()}:
        diagram = HumanoidDiagram(scenario, start_meshcat()[0], **blocks)
        assert not simulate(diagram, 0.05).error
    with pytest.raises(ValueError, match="^controller = Limp: .*'actuation'"):
        HumanoidDiagram(scenario, controller=Limp(22))


@pytest.mark.parametrize("robot", ["nadia", "g1"])
def test_parameters_of_a_robot_are_those_of_a_scenario_that_gives_none(robot):
    """Oracle: the layers: default by size, robot.yaml."""
    bare = load_scenario("walk_in_place", robot=robot)
    assert controller_params(robot) == bare.controller
    assert controller_params(robot).whole_body.joint_lower_limits


def test_a_block_that_is_left_out_is_a_mechanism_that_is_off():
    """Oracle: the same push with the blocks there, and their mechanisms off.

    Without a step adjuster the foot waits before lift-off for as long as it
    must; here it need not.
    """
    push = {"direction": "forward", "delta_v": 0.2}
    scenario = load_scenario("push", mechanisms="icp_only").with_push(**push)
    logs = [
        simulate(LipmDiagram(scenario, **blocks), 4.0).logs
        for blocks in ({}, {"step_adjuster": None, "timing_adapter": None})
    ]
    assert logs[0]["push_signal"].any()
    assert np.array_equal(logs[0]["icp"], logs[1]["icp"])


def test_a_block_that_needs_less_fits_each_diagram():
    """Oracle: Drake, which connects no port that is not there."""

    class Level(LeafSystem):
        def __init__(self):
            super().__init__()
            self.DeclareVectorOutputPort(
                "momentum_rate", 3, lambda _, output: output.set_value([0] * 3)
            )

    scenario = load_scenario("walk_in_place")
    for kind in LipmDiagram, HumanoidDiagram:
        diagram = kind(scenario, com_height_controller=Level())
        assert not simulate(diagram, 0.02).error


def test_an_error_before_the_first_row_is_the_reason():
    """Oracle: NaN, which is refused where it comes in."""

    class Wrong(LeafSystem):
        def __init__(self):
            super().__init__()
            self.DeclareVectorOutputPort(
                "momentum_rate",
                3,
                lambda _, output: output.set_value([math.nan] * 3),
            )

    scenario = load_scenario("walk_in_place", fidelity="ideal")
    diagram = HumanoidDiagram(scenario, com_height_controller=Wrong())
    reason = simulate(diagram, 0.1).summary["reason"]
    assert "'momentum_rate' is not finite at 0.000 s" in reason
