"""Terms of the equations of motion, computed by few Drake calls."""

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import Context

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Side
from nadia_balance.core.whole_body.command import (
    BASE,
    PELVIS,
    SOLES,
    TORSO,
    WholeBodyModel,
    WholeBodyTerms,
)
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import (
    body_poses,
    effort_limits,
    joints,
    joints_above,
    knee_among,
)

_V = JacobianWrtVariable.kV
_ORIGIN = np.zeros(3)
_UPRIGHT = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # positions of the base


class WholeBodyKinematics:
    """Computes the terms of the whole-body QP from a plant's context.

    The plant contains one robot: the pelvis as floating base, then joints of
    one degree of freedom, each with one actuator (see check_plant).

    Args:
        robot: the robot.
        plant: of the robot alone, in whose contexts it computes.
        lead: time [s] by which the positions are ahead of the velocities.
    """

    def __init__(
        self, robot: RobotModel, plant: MultibodyPlant, lead: float = 0.0
    ) -> None:
        self.plant: Any = plant
        self._lead = lead
        self._damping = np.zeros(plant.num_velocities())
        for joint in joints(plant):
            if joint.num_velocities() == 1:  # neither welded nor floating
                (damping,) = joint.default_damping_vector()
                self._damping[joint.velocity_start()] = damping
        feet = [plant.GetBodyByName(robot.foot_bodies[side]) for side in Side]
        torso = plant.GetBodyByName(robot.torso_body)
        self._bodies = [*feet, torso, plant.GetBodyByName(robot.pelvis_body)]
        # The frames of soles, torso and pelvis in these bodies (4, 4, 4).
        self._X_BodyFrame = np.tile(np.eye(4), (4, 1, 1))
        for i, side in enumerate(Side):
            self._X_BodyFrame[i] = robot.X_FootSole[side].GetAsMatrix4()
        # Rows of J, frame of the foot, and position of the sole in it.
        self._points = [
            (rows, foot.body_frame(), robot.X_FootSole[side].translation())
            for rows, foot, side in zip(SOLES, feet, Side, strict=True)
        ]
        self._torso = torso.body_frame()
        self._world = plant.world_frame()
        self._gravity = plant.gravity_field().gravity_vector()
        self._mass = robot.mass
        # Constant rows: the base's angular velocity is that of the pelvis.
        num_joints = plant.num_velocities() - 6
        self._rows = np.zeros((24 + num_joints, 7 + num_joints))
        self._rows[PELVIS, :3] = np.eye(3)

    def calc(self, context: Context) -> WholeBodyTerms:
        """The terms A vdot + a of soles, base, joints, torso and pelvis.

        Args:
            context: of the plant, at the robot's state.

        Returns:
            The terms, without link avoidance.
        """
        state: Any = self.plant.GetPositionsAndVelocities(context)
        v = state[-self._damping.size :]
        rows = self._rows.copy()
        self._fill_forces(context, v, rows)
        self._fill_motions(context, rows)
        poses = (
            body_poses(self.plant, context, self._bodies) @ self._X_BodyFrame
        )
        velocities = rows[:, :-1].dot(v)
        if self._lead:
            self._take_back(rows, v, velocities)
        return WholeBodyTerms(
            rows=rows,
            velocities=velocities,
            rotations=poses[:, :, :3],
            sole_positions=poses[:2, :, 3],
            q=state[: -v.size],
            v=v,
            com_state=_com_state(state[4:7], rows, velocities),
        )

    def _take_back(self, rows: Array, v: Array, velocities: Array) -> None:
        """Makes the `velocities` of soles, torso and momentum those of now.

        A(q) v, with q a lead L ahead of v, is too large by L dA/dt v: for soles
        and torso Jdot v; for the momentum the bias force without gravity, less
        the moment due to the motion of the base's origin.
        """
        turns = rows[: BASE.stop, -1].copy()
        turns[BASE] += rows[BASE, 3:6].dot(self._gravity)
        x, y, z = v[3:6].tolist()
        px, py, pz = velocities[BASE][3:].tolist()
        turns[BASE.start : BASE.start + 3] -= (
            y * pz - z * py,
            z * px - x * pz,
            x * py - y * px,
        )
        velocities[: BASE.stop] -= self._lead * turns
        velocities[TORSO] -= self._lead * rows[TORSO, -1]

    def _fill_forces(self, context: Context, v: Array, rows: Array) -> None:
        """Writes [M, bias] (nv, nv + 1) per mass, with gravity and damping."""
        M = self.plant.CalcMassMatrix(context)
        bias = self.plant.CalcBiasTerm(context)
        bias += self._damping * v
        # Gravity from M: the base's linear velocity is expressed in W.
        bias -= M[:, 3:6].dot(self._gravity)
        forces = rows[BASE.start : TORSO.start]
        np.divide(M, self._mass, out=forces[:, :-1])
        np.divide(bias, self._mass, out=forces[:, -1])

    def _fill_motions(self, context: Context, rows: Array) -> None:
        """Writes [J, Jdot v] of soles and torso.

        Drake's arguments are in order: by keyword a call takes half as long
        again.
        """
        plant, world = self.plant, self._world
        for sole, foot, p_FS in self._points:
            rows[sole, :-1] = plant.CalcJacobianSpatialVelocity(
                context, _V, foot, p_FS, world, world
            )
            rows[sole, -1] = plant.CalcBiasSpatialAcceleration(
                context, _V, foot, p_FS, world, world
            ).get_coeffs()
        rows[TORSO, :-1] = plant.CalcJacobianAngularVelocity(
            context, _V, self._torso, world, world
        )
        rows[TORSO, -1] = plant.CalcBiasSpatialAcceleration(
            context, _V, self._torso, _ORIGIN, world, world
        ).rotational()


def _com_state(p_WB: Array, rows: Array, velocities: Array) -> Array:
    """State (6,) of the centre of mass, from the base rows of M per mass.

    A linear velocity v of the base, expressed in W, gives the angular momentum
    p_BC x v per mass about the base's origin B, from which p_BC follows.
    """
    (_, _, y), (z, _, _), (_, x, _) = rows[BASE][:3, 3:6].tolist()
    px, py, pz = p_WB.tolist()
    return np.array((px + x, py + y, pz + z, *velocities[BASE][3:].tolist()))


def whole_body_model(
    robot: RobotModel, plant: MultibodyPlant, params: WholeBodyQpParams
) -> WholeBodyModel:
    """The constants of a robot, joints in the order of velocities.

    Args:
        robot: the robot.
        plant: of the robot alone, finalized.
        params: whose position limits count where they are tighter than those
            of the plant.

    Returns:
        The constants.

    Raises:
        ValueError: a named joint does not exist, or has no room to move.
    """
    lower = np.maximum(
        _by_joint(
            plant=plant,
            field="joint_lower_limits",
            values=params.joint_lower_limits,
            others=-np.inf,
        ),
        plant.GetPositionLowerLimits()[7:],
    )
    upper = np.minimum(
        _by_joint(
            plant=plant,
            field="joint_upper_limits",
            values=params.joint_upper_limits,
            others=np.inf,
        ),
        plant.GetPositionUpperLimits()[7:],
    )
    for joint in params.joint_lower_limits | params.joint_upper_limits:
        i = plant.GetJointByName(joint).velocity_start() - 6
        require(
            lower[i] < upper[i],
            f"joint_lower_limits.{joint} = {lower[i]}: must be below its upper "
            f"limit, {upper[i]} rad",
        )
    posture = _by_joint(
        plant=plant, field="posture", values=robot.posture, others=0.0
    )
    context = plant.CreateDefaultContext()
    upright: Any = np.concatenate((_UPRIGHT, posture))
    plant.SetPositions(context, upright)
    is_leg_joint, is_knee = np.zeros((2, lower.size), dtype=bool)
    for foot in robot.foot_bodies.values():
        leg = joints_above(plant, foot)
        is_leg_joint[[joint.velocity_start() - 6 for joint in leg]] = True
        knee = knee_among(leg, context)
        if knee:
            is_knee[knee.velocity_start() - 6] = True
    inertia = np.linalg.inv(plant.CalcMassMatrix(context))
    return WholeBodyModel(
        mass=robot.mass,
        sole_length=robot.sole_length,
        sole_width=robot.sole_width,
        ankles=np.array([_ankle(robot, plant, side) for side in Side]),
        posture=posture,
        position_lower=lower,
        position_upper=upper,
        max_torque=effort_limits(plant)[6:],
        max_speed=robot.max_joint_speeds,
        corner_speed=robot.corner_speeds,
        is_leg_joint=is_leg_joint,
        is_knee=is_knee,
        inertia=1.0 / np.diag(inertia)[6:],
        drives=robot.drives,
        given=tuple(
            _joint_number(plant, f"given_joints: {joint}", joint)
            for joint in params.given_joints
        ),
    )


def _by_joint(
    plant: MultibodyPlant,
    field: str,
    values: Mapping[str, float],
    others: float,
) -> Array:
    """The `values` (nj,) of a field, and those of `others`."""
    vector = np.full(plant.num_velocities() - 6, others)
    for joint, value in values.items():
        named = f"{field}.{joint} = {value}"
        vector[_joint_number(plant, named, joint)] = value
    return vector


def _joint_number(plant: MultibodyPlant, named: str, joint: str) -> int:
    """The joint's place among all; ValueError `named`: there is no such."""
    require(plant.HasJointNamed(joint), f"{named}: the robot has no such joint")
    return int(plant.GetJointByName(joint).velocity_start()) - 6


def _ankle(robot: RobotModel, plant: MultibodyPlant, side: Side) -> Array:
    """Position (3,) [m] of a leg's last joint in the frame of the sole."""
    foot = robot.foot_bodies[side]
    # Links welded to each other may lie between the two.
    p_FA: Any = plant.CalcPointsPositions(
        context=plant.CreateDefaultContext(),
        frame_B=joints_above(plant, foot)[0].frame_on_child(),
        p_BQi=cast(Any, _ORIGIN),
        frame_A=plant.GetBodyByName(foot).body_frame(),
    )
    return np.asarray(robot.X_FootSole[side].inverse() @ p_FA[:, 0])
