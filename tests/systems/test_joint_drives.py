"""Oracles: the torque-speed line and the law of the drives, by hand."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.robot.model import load_robot
from nadia_balance.robot.plants import actuators
from nadia_balance.systems.hardware import JointDrives
from tests.blocks import answer, fix, running
from tests.whole_body_examples import nadia, standing_state

PLANT, _ = nadia().add_plant_to(DiagramBuilder())
LIMITS = PLANT.GetEffortUpperLimits()


def torques(commanded: np.ndarray, state: np.ndarray):
    """What is there 0.1 s after a command, from nothing."""
    system = JointDrives(PLANT, nadia())
    simulator, context = running(system, actuation=commanded, state=state)
    simulator.AdvanceTo(0.1)
    return answer(system, context, "torques")


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("speed", "share"), [(6.0, 1.0), (9.0, 0.5), (15.0, 0)]
)
def test_what_drives_a_joint_fades_with_its_speed(speed, share, sign):
    """Oracle: the line; the other joints, and what brakes, have it all."""
    knee = PLANT.GetJointActuatorByName("LEFT_KNEE_Y")
    state, drives = standing_state(), LIMITS.copy()
    velocity = PLANT.num_positions() + knee.joint().velocity_start()
    state[velocity] = sign * speed
    drives[PLANT.GetActuatorNames().index("nadia_LEFT_KNEE_Y")] *= share
    reached = torques(2.0 * sign * LIMITS, state)
    assert reached == pytest.approx(sign * drives)
    reached = torques(-2.0 * sign * LIMITS, state)
    assert reached == pytest.approx(-sign * LIMITS)


@pytest.mark.parametrize("speed", [-18.6, 0.02, 18.6])
def test_a_motor_has_a_line_of_its_own(speed):
    """Oracle: Unitree's table of the G1's knee, by hand; others as the URDF."""
    robot = load_robot("g1")
    plant, _ = robot.add_plant_to(DiagramBuilder())
    system, limits = JointDrives(plant, robot), plant.GetEffortUpperLimits()
    knee = plant.GetJointActuatorByName("left_knee_joint")
    at = knee.input_start()
    state = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    state[plant.num_positions() + knee.joint().velocity_start()] = speed
    simulator, context = running(
        system, actuation=np.sign(speed) * limits, state=state
    )
    simulator.AdvanceTo(0.1)
    # 0.639 * 22.7 = 14.5 rad/s; half-way to 22.7 there is half of 111 N m.
    motor = 55.5 if abs(speed) > 14.5 else 111.0
    torques = answer(system, context, "torques")
    assert abs(torques[at]) == pytest.approx(motor, rel=2e-3)
    ankle = plant.GetActuatorNames().index("g1_left_ankle_roll_joint")
    assert abs(torques[ankle]) == pytest.approx(35.0)


def test_a_command_that_is_held_is_read_once_in_a_period():
    """Oracle: drives that read all steps, whose command changes in ticks."""
    step, states = PLANT.time_step(), standing_state()
    runs = []
    for period in (0.0, 4.0 * step):
        system = JointDrives(PLANT, nadia(), period)
        simulator, context = running(
            system, actuation=0.5 * LIMITS, state=states
        )
        reached = []
        for i in range(12):
            # Between ticks nonsense, for those that do not read it.
            share = (1.0 if i % 4 == 0 or not period else np.nan) * (1 + i // 4)
            fix(system, context, actuation=0.2 * share * LIMITS)
            simulator.AdvanceTo((i + 1) * step)
            reached.append(answer(system, context, "torques").copy())
        runs.append(reached)
    assert np.array_equal(*runs)
    assert np.all(np.diff(np.abs(runs[0]), axis=0) > 0.0)


def test_refuses_a_period_that_the_plant_does_not_keep():
    """Oracle: the message names both."""
    with pytest.raises(ValueError, match=r"^period = 0.0015: .* 0.001 s"):
        JointDrives(PLANT, nadia(), 0.0015)


@pytest.mark.parametrize("hardness", [0.5, 50.0])
def test_springs_and_dampers_act_in_every_step(hardness):
    """Oracle: the law by hand, within the limits; of each joint by itself."""
    rng = np.random.default_rng(7)
    plant, nu = nadia().control_plant(), LIMITS.size
    q, v, kp, kd = rng.uniform(0.5, 1.5, (4, nu))
    kp, tau = hardness * kp, 0.3 * LIMITS * rng.uniform(-1.0, 1.0, nu)
    joints = [a.joint() for a in actuators(plant)]
    now = standing_state().copy()
    places = [joint.position_start() for joint in joints]
    speeds = [plant.num_positions() + j.velocity_start() for j in joints]
    now[speeds] = rng.uniform(-1.0, 1.0, nu)
    system = JointDrives(PLANT, nadia(), 0.01)
    command = np.concatenate((q, v, tau, kp, kd))
    simulator, context = running(system, joint_command=command, state=now)
    simulator.AdvanceTo(0.101)
    # A state that changes within a period, in which the command is held.
    now[places] += 0.1
    fix(system, context, state=now, joint_command=np.full(5 * nu, np.nan))
    simulator.AdvanceTo(0.109)
    law = tau + kp * (q - now[places]) + kd * (v - now[speeds])
    law = law.clip(-LIMITS, LIMITS)
    last = (law + kp * 0.1).clip(-LIMITS, LIMITS)
    left = np.exp(-0.008 / nadia().drives.lag)  # of 8 steps
    expected = law + left * (last - law)
    assert answer(system, context, "torques") == pytest.approx(
        expected, rel=1e-3, abs=1e-3
    )


def test_gains_of_0_leave_torques_alone():
    """Oracle: drives that are told torques alone, to the last bit."""
    rng, nu = np.random.default_rng(8), LIMITS.size
    torques, targets = (
        2.0 * LIMITS * rng.normal(size=nu),
        rng.normal(size=2 * nu),
    )
    command = np.concatenate((targets, torques, np.zeros(2 * nu)))
    answers = []
    for inputs in {"actuation": torques}, {"joint_command": command}:
        system = JointDrives(PLANT, nadia())
        simulator, context = running(system, state=standing_state(), **inputs)
        simulator.AdvanceTo(0.003)
        answers.append(answer(system, context, "torques").tolist())
    assert answers[0] == answers[1]
