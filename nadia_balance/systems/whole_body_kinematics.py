"""Terms of the equations of motion, by Drake's cheapest calls."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import Context

from nadia_balance.core.walking import Side
from nadia_balance.core.whole_body_terms import (
    LEFT_SOLE,
    RIGHT_SOLE,
    TORSO,
    WholeBodyModel,
    WholeBodyTerms,
)
from nadia_balance.robot import RobotModel


class WholeBodyKinematics:
    """Reads what the whole-body QP needs from a plant's context.

    Needs a plant with one robot: the pelvis as floating base, then joints of
    one degree of freedom, each with one actuator.
    """

    def __init__(self, robot: RobotModel, plant: MultibodyPlant):
        """Raises ValueError if `plant` is built in another way."""
        self.plant = plant
        num_joints = plant.num_velocities() - 6
        pelvis = plant.GetBodyByName(robot.pelvis_body)
        if not (
            pelvis.is_floating_base_body()
            and pelvis.floating_positions_start() == 0
            and plant.num_positions() == 7 + num_joints
            and plant.num_actuators() == num_joints
        ):
            raise ValueError(
                f"{robot.name}: needs a floating {robot.pelvis_body}, joints "
                "of one degree of freedom, and one actuator for each"
            )
        self._damping = np.zeros(plant.num_velocities())
        for i in plant.GetJointIndices():
            joint = plant.get_joint(i)
            if joint.num_velocities() == 1:  # neither welded nor floating
                self._damping[joint.velocity_start()] = (
                    joint.default_damping_vector()[0]
                )
        # Left sole, right sole, torso, pelvis: body, and frame in it.
        self._frames = [
            (
                plant.GetBodyByName(robot.foot_bodies[side]),
                robot.X_FootSole[side],
            )
            for side in (Side.LEFT, Side.RIGHT)
        ]
        torso = plant.GetBodyByName(robot.torso_body)
        self._frames += [
            (torso, RigidTransform()),
            (pelvis, RigidTransform()),
        ]

    def calc(self, context: Context) -> WholeBodyTerms:
        """Returns the terms of the state in the plant's `context`."""
        plant = self.plant
        M, v = plant.CalcMassMatrix(context), plant.GetVelocities(context)
        # Gravity for free: the base's velocity is expressed in W.
        gravity = plant.gravity_field().gravity_vector()
        bias = plant.CalcBiasTerm(context) - M[:, 3:6] @ gravity
        bias += self._damping * v
        J, Jdot_v = self._motions(context)
        poses = [
            plant.EvalBodyPoseInWorld(context, body) @ X_BodyFrame
            for body, X_BodyFrame in self._frames
        ]
        return WholeBodyTerms(
            M=M,
            bias=bias,
            J=J,
            Jdot_v=Jdot_v,
            Jv=J @ v,
            rotations=np.array([X.rotation().matrix() for X in poses]),
            sole_positions=np.array([X.translation() for X in poses[:2]]),
            positions=plant.GetPositions(context)[7:],
            v=v,
        )

    def _motions(self, context):
        """Stacked Jacobian (15, nv) and bias (15,) of soles and torso."""
        J = np.empty((15, self.plant.num_velocities()))
        Jdot_v = np.empty(15)
        (left, X_L), (right, X_R), (torso, _), _ = self._frames
        for rows, body, X_BodyFrame in (
            (LEFT_SOLE, left, X_L),
            (RIGHT_SOLE, right, X_R),
        ):
            J[rows], Jdot_v[rows] = self._motion(
                context, body, X_BodyFrame.translation()
            )
        spatial = self._motion(context, torso, np.zeros(3))
        J[TORSO], Jdot_v[TORSO] = spatial[0][:3], spatial[1][:3]
        return J, Jdot_v

    def _motion(self, context, body, p_BP):
        """Jacobian (6, nv) and bias (6,) of [w, v] of a point of `body`."""
        plant, world = self.plant, self.plant.world_frame()
        frame = body.body_frame()
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, frame, p_BP, world, world
        )
        bias = plant.CalcBiasSpatialAcceleration(
            context, JacobianWrtVariable.kV, frame, p_BP, world, world
        )
        return J, bias.get_coeffs()


def whole_body_model(
    robot: RobotModel,
    plant: MultibodyPlant,
    joint_lower_limits: dict[str, float],
) -> WholeBodyModel:
    """Returns the constants of `robot`, joints in the order of velocities.

    Raises:
        ValueError: a joint that is named does not exist.
    """
    n = plant.num_velocities() - 6
    lower = plant.GetPositionLowerLimits()[7:].copy()
    upper = plant.GetPositionUpperLimits()[7:]
    posture = np.zeros(n)
    for joint, value in robot.posture.items():
        posture[_joint_index(plant, joint)] = value
    for joint, value in joint_lower_limits.items():
        index = _joint_index(plant, joint)
        lower[index] = max(lower[index], value)
    effort = np.zeros(n)
    for i in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(i)
        effort[actuator.joint().velocity_start() - 6] = actuator.effort_limit()
    return WholeBodyModel(
        mass=robot.mass,
        sole_length=robot.sole_length,
        sole_width=robot.sole_width,
        posture=posture,
        position_lower=lower,
        position_upper=upper,
        max_torque=effort,
        is_leg_joint=_is_leg_joint(robot, plant),
    )


def _is_leg_joint(robot: RobotModel, plant: MultibodyPlant) -> np.ndarray:
    """Marks (nj,) the joints between the pelvis and either foot."""
    context, world = plant.CreateDefaultContext(), plant.world_frame()
    moves = np.zeros(plant.num_velocities(), dtype=bool)
    for body in robot.foot_bodies.values():
        J = plant.CalcJacobianSpatialVelocity(
            context,
            JacobianWrtVariable.kV,
            plant.GetFrameByName(body),
            np.zeros(3),
            world,
            world,
        )
        moves |= np.any(J != 0.0, axis=0)
    return moves[6:]


def _joint_index(plant: MultibodyPlant, name: str) -> int:
    """Index of a joint among those of the robot."""
    if not plant.HasJointNamed(name):
        raise ValueError(f"joint = {name!r}: the robot has no such joint")
    return plant.GetJointByName(name).velocity_start() - 6
