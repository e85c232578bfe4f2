"""Plants other than Drake's: one that MuJoCo simulates, and the point mass."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
    PointPairContactInfo,
)
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    DiscreteValues,
    State,
)
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY, com_after, icp
from nadia_balance.core.walking.state import (
    FootPose,
    FootPoses,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.ports import (
    Block,
    declare_cache,
    declare_output,
    declare_update,
    input_port,
)
from nadia_balance.systems.signals import ComState


@dataclass(frozen=True)
class PointContacts:
    """Like Drake's ContactResults, which cannot be filled from Python."""

    pairs: tuple[PointPairContactInfo, ...] = ()

    def num_point_pair_contacts(self) -> int:
        """The number of point contacts.

        Returns:
            n.
        """
        return len(self.pairs)

    def point_pair_contact_info(self, i: int) -> PointPairContactInfo:
        """A point contact.

        Args:
            i: its number, < n.

        Returns:
            Its bodies, point and force.
        """
        return self.pairs[i]


class MujocoPlant(Block):
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

    def __init__(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        mjcf: Path | None = None,
    ) -> None:
        """Replaces a plant, with its time step.

        Args:
            plant: finalized and discrete.
            scene_graph: with its shapes and collision filters at this call.
            mjcf: what moves in the plant's place (see MujocoModel).

        Raises:
            ValueError: MuJoCo is not installed, or cannot express the plant.
        """
        super().__init__()
        try:  # here: it is optional, and slow to import
            from nadia_balance.engines.mujoco_model import MujocoModel
        except ModuleNotFoundError as error:
            if error.name != "mujoco":
                raise
            raise ValueError(
                "engine = 'mujoco': must have its package: pip install mujoco"
            ) from None
        self._model = MujocoModel(plant, scene_graph.model_inspector(), mjcf)
        self._actuation = input_port(self, "actuation", plant.num_actuators())
        self._forces = self.DeclareAbstractInputPort(
            "applied_spatial_force",
            AbstractValue.Make([ExternallyAppliedSpatialForce()]),
        )
        self._state: Any = self.DeclareDiscreteState(
            plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
        )
        self.DeclareStateOutputPort("state", self._state)
        self._step: Any = declare_cache(
            system=self,
            name="step",
            calc=self._calc_step,
            needs=[
                self.discrete_state_ticket(self._state),
                self._actuation,
                self._forces.ticket(),
            ],
        )
        self.DeclareAbstractOutputPort(
            name="contact_results",
            alloc=Value[object],
            calc=self._calc_contacts,
            prerequisites_of_calc={self._step.ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=plant.time_step(), offset_sec=0.0, update=self._update
        )

    def SetPositions(self, context: Context, q: Array) -> None:
        """Sets the positions.

        Args:
            context: that of this plant.
            q: positions (nq,).
        """
        x = context.get_discrete_state(self._state).value().copy()
        x[: len(q)] = q
        context.SetDiscreteState(x)

    def _calc_step(self, context: Context, _: Any) -> tuple[Array, object]:
        x: Any = context.get_discrete_state(self._state).value()
        forces: Any = (
            self._forces.Eval(context) if self._forces.HasValue(context) else ()
        )
        x, contacts = self._model.step(x, self._actuation(context), forces)
        return x, PointContacts(tuple(contacts))

    def _calc_contacts(self, context: Any, output: Any) -> None:
        output.set_value(self._step.Eval(context)[1])

    def _update(self, context: Context, state: DiscreteValues) -> None:
        x, _ = self._step.Eval(context)
        if not np.all(np.isfinite(x)):
            raise RuntimeError("MujocoPlant: the state is not finite")
        state.set_value(self._state, x)


def add_mujoco_plant(
    builder: DiagramBuilder,
    robot: RobotModel,
    time_step: float = 0.001,
    ground: Ground | None = None,
    mjcf: Path | None = None,
) -> tuple[MujocoPlant, MultibodyPlant, SceneGraph]:
    """Adds a MujocoPlant in which a robot stands.

    Args:
        builder: of the diagram.
        robot: the robot.
        time_step: of the plant [s].
        ground: what the robot stands on; None: it is flat.
        mjcf: what moves in the robot's place (see MujocoModel).

    Returns:
        The MujocoPlant; the MultibodyPlant that it replaces, which is no part
        of the diagram; and the SceneGraph, which is one, with all poses.

    Raises:
        ValueError: MuJoCo is not installed, or cannot express the robot.
    """
    scene_graph = SceneGraph()
    builder.AddNamedSystem("scene_graph", scene_graph)
    plant = MultibodyPlant(time_step)
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    robot.stand_in(plant, scene_graph, ground)
    engine = MujocoPlant(plant, scene_graph, mjcf)
    builder.AddNamedSystem("mujoco_plant", engine)
    poses = builder.AddNamedSystem(
        "poses", MultibodyPositionToGeometryPose(plant, True)
    )
    builder.Connect(engine.GetOutputPort("state"), poses.get_input_port())
    builder.Connect(
        poses.get_output_port(),
        scene_graph.get_source_pose_port(cast(Any, plant.get_source_id())),
    )
    return engine, plant, scene_graph


class PointMassPlant(Block):
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
        self, model: PointMassModel, period: float, start: WalkingState
    ) -> None:
        """Integrates from a state of rest or walking.

        Args:
            model: point mass, its height and sole.
            period: of a tick [s].
            start: walking state at the start, with CoM and feet.
        """
        super().__init__()
        self._omega = model.omega
        self._period = period
        self._weight = model.mass * GRAVITY
        self._stiffness = model.mass * model.omega**2
        point = start.schedule.start
        foot = start.schedule.feet[start.schedule.support_side.other]
        self._com: Any = self.DeclareDiscreteState(
            cast(Any, [*point.com, model.com_height, *point.com_velocity, 0.0])
        )
        self._foot: Any = self.DeclareDiscreteState(
            cast(Any, [*foot.p_WF, foot.yaw])
        )
        self._ecmp = input_port(self, "ecmp_command")
        self._swing = input_port(self, "swing_foot_reference")
        self._walking = input_port(self, "walking_state")
        self._push = input_port(self, "push_force")
        self.DeclareStateOutputPort("com_state", self._com)
        feet_tickets = [
            self.discrete_state_ticket(self._foot),
            self._walking.ticket(),
        ]
        declare_output(
            system=self,
            name="icp",
            calc=self._calc_icp,
            needs=[self.discrete_state_ticket(self._com)],
        )
        declare_output(
            system=self,
            name="foot_poses",
            calc=self._calc_foot_poses,
            needs=feet_tickets,
        )
        declare_output(
            system=self,
            name="foot_forces",
            calc=self._calc_forces,
            needs=feet_tickets,
        )
        declare_update(self, period, self._step)

    def _calc_icp(self, context: Context) -> Array:
        com = ComState(context.get_discrete_state(self._com).value())
        return icp(com.position[:2], com.velocity[:2], self._omega)

    def _calc_foot_poses(self, context: Context) -> FootPoses:
        schedule = self._walking(context).schedule
        feet: FootPoses = schedule.feet
        if schedule.phase is not Phase.SWING:
            return feet
        x, y, z, yaw = self._swing_foot(context)
        z = max(z, min(feet.left.p_WF[2], feet.right.p_WF[2]))
        return feet.with_foot(
            schedule.support_side.other, FootPose(np.array([x, y, z]), yaw)
        )

    def _calc_forces(self, context: Context) -> tuple[float, float]:
        schedule = self._walking(context).schedule
        left = right = True
        if schedule.phase is Phase.SWING:
            ground = schedule.footsteps[0].pose.p_WF[2]
            if self._swing_foot(context)[2] > ground + 1e-4:
                left = schedule.in_contact(Side.LEFT)
                right = not left
        share = self._weight / (left + right)
        return share * left, share * right

    def _swing_foot(self, context: Context) -> Any:
        return context.get_discrete_state(self._foot).value().tolist()

    def _step(self, context: Context, state: State) -> None:
        t = self._period
        com = ComState(context.get_discrete_state(self._com).value().copy())
        com.position[:2], com.velocity[:2] = com_after(
            com=com.position[:2],
            com_velocity=com.velocity[:2],
            ecmp=self._ecmp(context).ecmp
            - self._push(context)[:2] / self._stiffness,
            omega=self._omega,
            t=t,
        )
        state.get_mutable_discrete_state(self._com).set_value(com[:])
        foot = self._swing(context)
        half = 0.5 * t**2
        p = foot.position + t * foot.velocity + half * foot.acceleration
        yaw = foot.yaw + t * foot.yaw_rate + half * foot.yaw_acceleration
        state.get_mutable_discrete_state(self._foot).set_value(
            cast(Any, [*p, yaw])
        )
