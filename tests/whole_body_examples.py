"""Nadia's terms, and things to do, for the tests of the whole-body QP."""

import functools
import math
from dataclasses import replace

import numpy as np
from pydrake.systems.framework import Context

from nadia_balance.core.math.qp import QpProblem
from nadia_balance.core.whole_body import command as whole_body_command
from nadia_balance.core.whole_body.limits import WholeBodyLimits
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.core.whole_body.qp import WholeBodyQp, WholeBodySolution
from nadia_balance.robot.kinematics import WholeBodyKinematics, whole_body_model
from nadia_balance.robot.model import RobotModel, load_robot
from tests.qp_examples import with_slack

# The solver accepts 1e-8 of the largest acceleration, here times 91 kg.
ROUNDING = 1e-5  # [N], [N m]

PERIOD = 0.002  # [s]

CONTACTS = [(True, True), (True, False), (False, True)]


@functools.cache
def nadia() -> RobotModel:
    return load_robot("nadia", "realistic")


@functools.cache
def standing_positions() -> np.ndarray:
    return nadia().standing_positions()


@functools.cache
def kinematics() -> WholeBodyKinematics:
    return WholeBodyKinematics(nadia(), nadia().control_plant())


def model(**joint_lower_limits) -> whole_body_command.WholeBodyModel:
    params = WholeBodyQpParams(joint_lower_limits=joint_lower_limits)
    return whole_body_model(nadia(), kinematics().plant, params)


def random_state(seed: int, size: float = 1.0) -> np.ndarray:
    """[q, v] about standing; `size` 1 is a brisk walk."""
    rng = np.random.default_rng(seed)
    q, nv = standing_positions().copy(), kinematics().plant.num_velocities()
    q[1:] += 0.03 * size * rng.normal(size=q.size - 1)
    q[:4] /= np.linalg.norm(q[:4])
    return np.concatenate([q, 0.2 * size * rng.normal(size=nv)])


def context_at(state: np.ndarray) -> Context:
    plant = kinematics().plant
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    return context


def terms_at(state: np.ndarray) -> whole_body_command.WholeBodyTerms:
    return kinematics().calc(context_at(state))


def standing_state() -> np.ndarray:
    nv = kinematics().plant.num_velocities()
    return np.concatenate([standing_positions(), np.zeros(nv)])


def command(
    terms: whole_body_command.WholeBodyTerms,
    contacts: tuple[bool, bool] = (True, True),
    momentum_rate=(0.0, 0.0, 0.0),
    max_normal_forces=(math.inf, math.inf),
    friction=0.6,
) -> whole_body_command.WholeBodyCommand:
    """Pelvis and torso ahead; a swing foot stays where it is."""
    swing = np.zeros(12)
    if not all(contacts):
        swing[:3] = terms.sole_positions[contacts.index(False)]
    return whole_body_command.WholeBodyCommand(
        momentum_rate=np.array(momentum_rate, dtype=float),
        heading=(0.0, 0.0, 0.0),
        turn=(0.0, 0.0, 0.0),
        contacts=contacts,
        max_normal_forces=max_normal_forces,
        swing=swing,
        normals=np.array([[0.0, 0.0, 1.0]] * 2),
        friction=friction,
    )


def solve(
    state: np.ndarray,
    contacts: tuple[bool, bool] = (True, True),
    params: WholeBodyQpParams | None = None,
    max_torque: np.ndarray | None = None,
    **kwargs,
) -> tuple[whole_body_command.WholeBodyTerms, WholeBodySolution]:
    """The terms at `state`, and the solution of a `command` there."""
    terms = terms_at(state)
    robot = model()
    if max_torque is not None:
        robot = replace(robot, max_torque=max_torque)
    qp = WholeBodyQp(params or WholeBodyQpParams(), robot, PERIOD)
    found = qp.solve(terms, command(terms, contacts, **kwargs))
    assert found.qp.solved
    return terms, found


def yielding(problem: QpProblem) -> QpProblem:
    """The program, on two soles, whose limits of joints and tilt yield."""
    upper = problem.upper.copy()
    upper[66:68] = np.inf  # of what is missing of torso and pelvis
    joints = range(41, 64)
    return with_slack(problem._replace(upper=upper), dict.fromkeys(joints, 1.0))


def make_infeasible(monkeypatch):
    """Bounds one force from below by 1 and from above by -1."""
    fill = WholeBodyLimits.fill

    def impossible(self, C, bounds, **arguments):
        fill(self, C=C, bounds=bounds, **arguments)
        C[-2] = C[-1]
        bounds[:, -2:] = [[1.0, -np.inf], [np.inf, -1.0]]

    monkeypatch.setattr(WholeBodyLimits, "fill", impossible)
