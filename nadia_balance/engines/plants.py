"""Plants other than Drake's: one that MuJoCo simulates, and the point mass."""

from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import SceneGraph
from pydrake.multibody import plant as mbp
from pydrake.systems import framework
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.lipm import GRAVITY, com_after, icp
from nadia_balance.core.walking import state as walking
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems import ports
from nadia_balance.systems.signals import ComState


@dataclass(frozen=True)
class PointContacts:
    """Like Drake's ContactResults, which cannot be filled from Python."""

    pairs: tuple[mbp.PointPairContactInfo, ...] = ()

    def num_point_pair_contacts(self) -> int:
        """The number of point contacts."""
        return len(self.pairs)

    def point_pair_contact_info(self, i: int) -> mbp.PointPairContactInfo:
        """Bodies, point and force of contact `i`."""
        return self.pairs[i]


class MujocoPlant(framework.LeafSystem):
    """Simulates a robot and its ground by MuJoCo, with the ports of a plant.

    `actuation` (nu,) [N m] and `state`, [q, v], are in the order of the
    MultibodyPlant that it replaces.  `contact_results` are the PointContacts
    of the step that begins.  The discrete state is `state`; MuJoCo's data is
    scratch.  An update raises RuntimeError if the new state is not finite.

    .. pydrake_system::

        name: MujocoPlant
        input_ports: [actuation, applied_spatial_force]
        output_ports: [state, contact_results]
    """

    def __init__(self, plant: mbp.MultibodyPlant, scene_graph: SceneGraph):
        """Replaces `plant`, finalized and discrete, with its time step.

        Shapes and collision filters are those of `scene_graph` at this call.

        Raises ValueError: MuJoCo is not installed, or cannot express the plant.
        """
        super().__init__()
        try:  # here: it is optional, and slow to import
            from nadia_balance.engines.mujoco_model import MujocoModel
        except ModuleNotFoundError as error:
            if error.name != "mujoco":
                raise
            why = "must have its package: pip install mujoco"
            raise ValueError(f"engine = 'mujoco': {why}") from None
        self._model = MujocoModel(plant, scene_graph.model_inspector())
        self._actuation = ports.Input(self, "actuation", plant.num_actuators())
        forces = AbstractValue.Make([mbp.ExternallyAppliedSpatialForce()])
        name = "applied_spatial_force"
        self._forces = self.DeclareAbstractInputPort(name, forces)
        x = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
        self._state = self.DeclareDiscreteState(x)
        self.DeclareStateOutputPort("state", self._state)
        state = self.discrete_state_ticket(self._state)
        needs = [state, self._actuation, self._forces]
        self._step = ports.declare_cache(self, "step", self._calc_step, needs)
        out = "contact_results", Value[object], self._calc_contacts
        self.DeclareAbstractOutputPort(*out, {self._step.ticket()})
        step = plant.time_step()
        self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._update)

    def SetPositions(self, context: framework.Context, q: np.ndarray) -> None:
        """Sets the positions q (nq,) in `context`."""
        x = context.get_discrete_state(self._state).value().copy()
        x[: len(q)] = q
        context.SetDiscreteState(x)

    def _calc_step(self, context, _) -> tuple[np.ndarray, PointContacts]:
        x = context.get_discrete_state(self._state).value()
        pushed = self._forces.HasValue(context)
        forces = self._forces.Eval(context) if pushed else ()
        x, contacts = self._model.step(x, self._actuation(context), forces)
        return x, PointContacts(tuple(contacts))

    def _calc_contacts(self, context, output):
        output.set_value(self._step.Eval(context)[1])

    def _update(self, context, state):
        x, _ = self._step.Eval(context)
        if not np.all(np.isfinite(x)):
            raise RuntimeError("MujocoPlant: the state is not finite")
        state.set_value(self._state, x)
        return framework.EventStatus.Succeeded()


def add_mujoco_plant(
    builder: framework.DiagramBuilder,
    robot: RobotModel,
    time_step: float = 0.001,
    ground: Ground | None = None,
) -> tuple[MujocoPlant, mbp.MultibodyPlant, SceneGraph]:
    """Adds a MujocoPlant in which `robot` stands on the `ground`.

    `time_step` [s]; without `ground` it is flat.  The replaced MultibodyPlant
    is no part of the diagram; the SceneGraph is, with all poses.

    Raises ValueError: MuJoCo is not installed, or cannot express the robot.
    """
    scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
    plant = mbp.MultibodyPlant(time_step)
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    robot.stand_in(plant, scene_graph, ground)
    engine, add = MujocoPlant(plant, scene_graph), builder.AddNamedSystem
    add("mujoco_plant", engine)
    poses = add("poses", MultibodyPositionToGeometryPose(plant, True))
    builder.Connect(engine.GetOutputPort("state"), poses.get_input_port())
    seen = scene_graph.get_source_pose_port(plant.get_source_id())
    builder.Connect(poses.get_output_port(), seen)
    return engine, plant, scene_graph


class PointMassPlant(framework.LeafSystem):
    """Integrates the linear inverted pendulum under the commanded eCMP.

    The swing foot follows its reference exactly, with constant acceleration
    within a tick.  A foot carries weight if it is in contact by the plan, or if
    it is the swing foot and has come down to the ground.

    Discrete states: [p_WC(3), v_WC(3)], exact between ticks for a constant eCMP
    and push, and [p(3), yaw] of the swing foot.

    .. pydrake_system::

        name: PointMassPlant
        input_ports: [ecmp_command, swing_foot_reference, walking_state,
                      push_force]
        output_ports: [com_state, icp, foot_poses, foot_forces]
    """

    def __init__(
        self, model: PointMassModel, period: float, start: walking.WalkingState
    ):
        """Integrates `model` from `start` on, one tick per `period` [s]."""
        super().__init__()
        self._omega, self._period = model.omega, period
        self._weight = model.mass * GRAVITY
        self._stiffness = model.mass * model.omega**2
        schedule = start.schedule
        point, foot = schedule.start, schedule.feet[schedule.support_side.other]
        com = [*point.com, model.com_height, *point.com_velocity, 0.0]
        self._com = self.DeclareDiscreteState(com)
        self._foot = self.DeclareDiscreteState([*foot.p_WF, foot.yaw])
        self._ecmp = ports.input_port(self, "ecmp_command")
        self._swing = ports.input_port(self, "swing_foot_reference")
        self._walking = ports.input_port(self, "walking_state")
        self._push = ports.input_port(self, "push_force")
        self.DeclareStateOutputPort("com_state", self._com)
        com = [self.discrete_state_ticket(self._com)]
        ports.declare_output(self, "icp", self._calc_icp, com)
        feet = [self.discrete_state_ticket(self._foot), self._walking]
        ports.declare_output(self, "foot_poses", self._calc_foot_poses, feet)
        ports.declare_output(self, "foot_forces", self._calc_forces, feet)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._step)

    def _calc_icp(self, context) -> np.ndarray:
        com = ComState(context.get_discrete_state(self._com).value())
        return icp(com.position[:2], com.velocity[:2], self._omega)

    def _calc_foot_poses(self, context) -> walking.FootPoses:
        schedule = self._schedule(context)
        feet = schedule.feet
        if schedule.phase is not walking.Phase.SWING:
            return feet
        x, y, z, yaw = self._swing_foot(context)
        ground = min(feet.left.p_WF[2], feet.right.p_WF[2])
        pose = walking.FootPose(np.array([x, y, max(z, ground)]), yaw)
        return feet.with_foot(schedule.support_side.other, pose)

    def _calc_forces(self, context) -> tuple[float, float]:
        schedule, left, right = self._schedule(context), True, True
        if schedule.phase is walking.Phase.SWING:
            ground = schedule.footsteps[0].pose.p_WF[2]
            if self._swing_foot(context)[2] > ground + 1e-4:
                left = schedule.in_contact(walking.Side.LEFT)
                right = not left
        share = self._weight / (left + right)
        return share * left, share * right

    def _schedule(self, context):
        return self._walking(context).schedule

    def _swing_foot(self, context) -> list[float]:
        return context.get_discrete_state(self._foot).value().tolist()

    def _step(self, context, state):
        com = ComState(context.get_discrete_state(self._com).value().copy())
        pivot = self._ecmp(context).ecmp
        pivot = pivot - self._push(context)[:2] / self._stiffness
        com.position[:2], com.velocity[:2] = com_after(
            com.position[:2], com.velocity[:2], pivot, self._omega, self._period
        )
        state.get_mutable_discrete_state(self._com).set_value(com[:])
        foot, t, t2 = self._swing(context), self._period, 0.5 * self._period**2
        p = foot.position + t * foot.velocity + t2 * foot.acceleration
        yaw = foot.yaw + t * foot.yaw_rate + t2 * foot.yaw_acceleration
        state.get_mutable_discrete_state(self._foot).set_value([*p, yaw])
        return framework.EventStatus.Succeeded()
