"""A plant that MuJoCo simulates, with the ports of Drake's MultibodyPlant."""

from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
    PointPairContactInfo,
)
from pydrake.systems import framework
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from nadia_balance.core.body.ground import Ground
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.ports import Input, declare_cache


@dataclass(frozen=True)
class PointContacts:
    """Point contacts with the interface of Drake's ContactResults.

    ContactResults itself cannot be filled from Python.
    """

    pairs: tuple[PointPairContactInfo, ...] = ()

    def num_point_pair_contacts(self) -> int:
        """The number of point contacts."""
        return len(self.pairs)

    def point_pair_contact_info(self, i: int) -> PointPairContactInfo:
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

    def __init__(self, plant: MultibodyPlant, scene_graph: SceneGraph):
        """Replaces `plant`, finalized and discrete, with its time step.

        Shapes and collision filters are those of `scene_graph` at this call.

        Raises ValueError: MuJoCo is not installed, or cannot express the plant.
        """
        super().__init__()
        try:  # here: it is optional, and slow to import
            from nadia_balance.engines.mujoco_model import MujocoModel
        except ImportError:
            raise ValueError(
                "engine = 'mujoco': must have its package: pip install mujoco"
            ) from None
        self._model = MujocoModel(plant, scene_graph.model_inspector())
        self._actuation = Input(self, "actuation", plant.num_actuators())
        self._forces = self.DeclareAbstractInputPort(
            "applied_spatial_force",
            AbstractValue.Make([ExternallyAppliedSpatialForce()]),
        )
        default = plant.CreateDefaultContext()
        self._state = self.DeclareDiscreteState(
            plant.GetPositionsAndVelocities(default)
        )
        self.DeclareStateOutputPort("state", self._state)
        needs = [
            self.discrete_state_ticket(self._state),
            self._actuation,
            self._forces,
        ]
        self._step = declare_cache(self, "step", self._calc_step, needs)
        self.DeclareAbstractOutputPort(
            "contact_results",
            lambda: Value[object](),
            self._calc_contacts,
            {self._step.ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            plant.time_step(), 0.0, self._update
        )

    def SetPositions(self, context: framework.Context, q: np.ndarray) -> None:
        """Sets the positions q (nq,) in `context`."""
        x = context.get_discrete_state(self._state).value().copy()
        x[: len(q)] = q
        context.SetDiscreteState(x)

    def _calc_step(
        self, context: framework.Context, _
    ) -> tuple[np.ndarray, PointContacts]:
        forces = self._forces
        x, contacts = self._model.step(
            context.get_discrete_state(self._state).value(),
            self._actuation(context),
            forces.Eval(context) if forces.HasValue(context) else (),
        )
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
) -> tuple[MujocoPlant, MultibodyPlant, SceneGraph]:
    """Adds a MujocoPlant in which `robot` stands on the `ground`.

    `time_step` [s]; without `ground` it is flat.  The MultibodyPlant that the
    engine replaces is not part of the diagram; the SceneGraph is, with all
    poses.

    Raises ValueError: MuJoCo is not installed, or cannot express the robot.
    """
    scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
    plant = MultibodyPlant(time_step)
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    robot.stand_in(plant, scene_graph, ground)
    engine = builder.AddNamedSystem(
        "mujoco_plant", MujocoPlant(plant, scene_graph)
    )
    poses = builder.AddNamedSystem(
        "poses",
        MultibodyPositionToGeometryPose(plant, input_multibody_state=True),
    )
    builder.Connect(engine.GetOutputPort("state"), poses.get_input_port())
    builder.Connect(
        poses.get_output_port(),
        scene_graph.get_source_pose_port(plant.get_source_id()),
    )
    return engine, plant, scene_graph
