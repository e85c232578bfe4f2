"""Terms of the equations of motion, computed by few Drake calls."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import Context

from nadia_balance.core.math.arrays import cross
from nadia_balance.core.walking.state import Side
from nadia_balance.core.whole_body import command
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.robot import plants
from nadia_balance.robot.model import RobotModel

_V, _ORIGIN = JacobianWrtVariable.kV, np.zeros(3)


class WholeBodyKinematics:
    """Computes the terms of the whole-body QP from a plant's context.

    The plant contains one robot: the pelvis as floating base, then joints of
    one degree of freedom, each with one actuator (see check_plant).
    """

    def __init__(self, robot: RobotModel, plant: MultibodyPlant, lead=0.0):
        """Computes in a context of `plant`, of the `robot` alone.

        The positions are a `lead` [s] ahead of the velocities.
        """
        self.plant, self._lead = plant, lead
        num_joints = plant.num_velocities() - 6
        pelvis = plant.GetBodyByName(robot.pelvis_body)
        self._damping = np.zeros(plant.num_velocities())
        for joint in plants.joints(plant):
            if joint.num_velocities() == 1:  # neither welded nor floating
                (damping,) = joint.default_damping_vector()
                self._damping[joint.velocity_start()] = damping
        feet = [plant.GetBodyByName(robot.foot_bodies[side]) for side in Side]
        torso = plant.GetBodyByName(robot.torso_body)
        self._bodies = [*feet, torso, pelvis]
        # The frames of soles, torso and pelvis in these bodies (4, 4, 4).
        self._X_BodyFrame = np.tile(np.eye(4), (4, 1, 1))
        for i, side in enumerate(Side):
            self._X_BodyFrame[i] = robot.X_FootSole[side].GetAsMatrix4()
        # Rows of J, frame of the foot, and position of the sole in it.
        self._points = [
            (rows, foot.body_frame(), robot.X_FootSole[side].translation())
            for rows, foot, side in zip(command.SOLES, feet, Side, strict=True)
        ]
        self._torso, self._world = torso.body_frame(), plant.world_frame()
        self._gravity = plant.gravity_field().gravity_vector()
        self._mass = robot.mass
        # Constant rows: the base's angular velocity is that of the pelvis.
        self._rows = np.zeros((24 + num_joints, 7 + num_joints))
        self._rows[command.PELVIS, :3] = np.eye(3)

    def calc(self, context: Context) -> command.WholeBodyTerms:
        """Returns the terms of the state in the plant's `context`."""
        plant, rows = self.plant, self._rows.copy()
        state = plant.GetPositionsAndVelocities(context)
        v = state[-self._damping.size :]
        self._fill_forces(context, v, rows)
        self._fill_motions(context, rows)
        poses = plants.body_poses(plant, context, self._bodies)
        poses = poses @ self._X_BodyFrame
        velocities = rows[:, :-1] @ v
        if self._lead:
            self._take_back(rows, v, velocities)
        return command.WholeBodyTerms(
            rows=rows,
            velocities=velocities,
            rotations=poses[:, :, :3],
            sole_positions=poses[:2, :, 3],
            q=state[: -v.size],
            v=v,
            com_state=_com_state(state[4:7], rows, velocities),
        )

    def _take_back(self, rows, v, velocities):
        """Makes the `velocities` of soles, torso and momentum those of now.

        A(q) v, with q a lead L ahead of v, is too large by L dA/dt v: for soles
        and torso Jdot v; for the momentum the bias force without gravity, less
        the moment due to the motion of the base's origin.
        """
        turns = rows[:, -1].copy()
        turns[command.PELVIS] = 0.0
        turns[command.BASE] += rows[command.BASE, 3:6] @ self._gravity
        moved = cross(v[3:6], velocities[command.BASE][3:])
        turns[command.BASE.start : command.BASE.start + 3] -= moved
        turns[command.BASE.stop : command.TORSO.start] = 0.0
        velocities -= self._lead * turns

    def _fill_forces(self, context, v, rows):
        """Writes [M, bias] (nv, nv + 1) per mass, with gravity and damping."""
        M = self.plant.CalcMassMatrix(context)
        bias = self.plant.CalcBiasTerm(context) + self._damping * v
        # Gravity from M: the base's linear velocity is expressed in W.
        bias -= M[:, 3:6] @ self._gravity
        forces = rows[command.BASE.start : command.TORSO.start]
        forces[:, :-1], forces[:, -1] = M, bias
        forces /= self._mass

    def _fill_motions(self, context, rows):
        """Writes [J, Jdot v] of soles and torso."""
        plant, world = self.plant, self._world
        move = plant.CalcJacobianSpatialVelocity
        turn = plant.CalcJacobianAngularVelocity
        bias = plant.CalcBiasSpatialAcceleration
        for sole, frame, p_BP in self._points:
            rows[sole, :-1] = move(context, _V, frame, p_BP, world, world)
            of = context, _V, frame, p_BP, world, world
            rows[sole, -1] = bias(*of).get_coeffs()
        torso = self._torso
        rows[command.TORSO, :-1] = turn(context, _V, torso, world, world)
        of = context, _V, torso, _ORIGIN, world, world
        rows[command.TORSO, -1] = bias(*of).rotational()


def _com_state(p_WB, rows, velocities) -> np.ndarray:
    """State (6,) of the centre of mass, from the base rows of M per mass.

    A linear velocity v of the base, expressed in W, gives the angular momentum
    p_BC x v per mass about the base's origin B, from which p_BC follows.
    """
    (_, _, y), (z, _, _), (_, x, _) = rows[command.BASE][:3, 3:6].tolist()
    return np.concatenate((p_WB + (x, y, z), velocities[command.BASE][3:]))


def whole_body_model(
    robot: RobotModel, plant: MultibodyPlant, params: WholeBodyQpParams
) -> command.WholeBodyModel:
    """Returns the constants of `robot`, joints in the order of velocities.

    Position limits are the tighter ones of `plant` and `params`.

    Raises ValueError: a named joint does not exist, or has no room to move.
    """
    n = plant.num_velocities() - 6

    def index(joint: str) -> int:
        return plant.GetJointByName(joint).velocity_start() - 6

    def values(of: object, field: str, others: float) -> np.ndarray:
        found = np.full(n, others)
        for joint, value in getattr(of, field).items():
            if not plant.HasJointNamed(joint):
                why = f"{field}.{joint} = {value}: the robot has no such joint"
                raise ValueError(why)
            found[index(joint)] = value
        return found

    is_leg_joint, ankles = np.zeros(n, dtype=bool), []
    context = plant.CreateDefaultContext()
    for side, foot in robot.foot_bodies.items():
        leg = plants.joints_above(plant, foot)
        is_leg_joint[[joint.velocity_start() - 6 for joint in leg]] = True
        ankle, body = leg[0].frame_on_child(), plant.GetBodyByName(foot)
        # Links welded to each other may lie between the two.
        of = context, ankle, _ORIGIN, body.body_frame()
        p_FootA = plant.CalcPointsPositions(*of)[:, 0]
        ankles.append(robot.X_FootSole[side].inverse() @ p_FootA)

    lower = values(params, "joint_lower_limits", -np.inf)
    upper = values(params, "joint_upper_limits", np.inf)
    lower = np.maximum(lower, plant.GetPositionLowerLimits()[7:])
    upper = np.minimum(upper, plant.GetPositionUpperLimits()[7:])
    for joint in params.joint_lower_limits | params.joint_upper_limits:
        if not lower[i := index(joint)] < upper[i]:
            why = f"must be below its upper limit, {upper[i]} rad"
            raise ValueError(f"joint_lower_limits.{joint} = {lower[i]}: {why}")
    return command.WholeBodyModel(
        mass=robot.mass,
        sole_length=robot.sole_length,
        sole_width=robot.sole_width,
        ankles=np.array(ankles),
        posture=values(robot, "posture", 0.0),
        position_lower=lower,
        position_upper=upper,
        max_torque=plants.effort_limits(plant)[6:],
        max_speed=robot.max_joint_speeds,
        is_leg_joint=is_leg_joint,
        drives=robot.drives,
    )
