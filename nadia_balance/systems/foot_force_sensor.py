"""Vertical force on each foot."""

import numpy as np
from pydrake.multibody.plant import ContactModel, ContactResults, MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import EventStatus, LeafSystem, System

from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.robot.model import RobotModel


class FootForceSensor(LeafSystem):
    """Computes the mean vertical contact force on each foot over a period.

    `foot_forces`, a FootForces [N], is the component along z of W (the normal
    force on level ground), clipped at 0 in every step.  Contacts among the
    robot's own bodies are left out.  After a hard touchdown a foot bounces
    within one step of the plant, so every step is measured.  The first group
    of the discrete state is the output, the second holds the forces in the
    steps of the period, the latest first.

    .. pydrake_system::

        name: FootForceSensor
        input_ports: [contact_results]
        output_ports: [foot_forces]
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        robot: RobotModel,
        period: float,
        engine: System | None = None,
    ):
        """Measures the feet of `robot` in `plant`, over a `period` [s].

        `engine` is the system that computes the contacts, by default `plant`.

        Raises:
            ValueError: the period is not a multiple of the plant's time step.
        """
        super().__init__()
        step = plant.time_step()
        self._steps = round(period / step) if step > 0.0 else 0
        if self._steps < 1 or abs(self._steps * step - period) > 1e-9:
            raise ValueError(
                f"period = {period}: must be a multiple of the plant's "
                f"time_step = {step} s"
            )
        feet = [plant.GetBodyByName(robot.foot_bodies[side]) for side in Side]
        own = plant.GetBodyIndices(feet[0].model_instance())
        bodies = [BodyIndex(i) for i in range(plant.num_bodies())]
        # For bodies (A, B) in contact: the foot among them, and the sign of
        # the force on it; contact results list the force on B.
        self._foot_of = {}
        for i, foot in enumerate(feet):
            for other in (int(body) for body in bodies if body not in own):
                self._foot_of[other, int(foot.index())] = i, 1.0
                self._foot_of[int(foot.index()), other] = i, -1.0
        self._has_patches = plant.get_contact_model() != ContactModel.kPoint
        self._body_of = {
            geometry: int(body)
            for body in bodies
            for geometry in plant.GetCollisionGeometriesForBody(
                plant.get_body(body)
            )
        }
        self._contact_results = self.DeclareAbstractInputPort(
            "contact_results",
            (engine or plant).GetOutputPort("contact_results").Allocate(),
        )
        self._mean = self.DeclareDiscreteState(2)
        self._samples = self.DeclareDiscreteState(2 * self._steps)
        # Matrix that averages the samples.
        self._average = np.tile(np.eye(2), self._steps) / self._steps
        self.DeclareStateOutputPort("foot_forces", self._mean)
        self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._measure)

    def _measure(self, context, state):
        left, right = self._forces(self._contact_results.Eval(context))
        last = context.get_discrete_state(self._samples).value()[:-2]
        samples = np.array((max(left, 0.0), max(right, 0.0), *last.tolist()))
        state.set_value(self._samples, samples)
        state.set_value(self._mean, self._average @ samples)
        return EventStatus.Succeeded()

    def _forces(self, results: ContactResults) -> list[float]:
        """The vertical forces [N] on left and right foot in this step."""
        forces, foot_of = [0.0, 0.0], self._foot_of
        info = results.point_pair_contact_info
        for i in range(results.num_point_pair_contacts()):
            pair = info(i)
            bodies = int(pair.bodyA_index()), int(pair.bodyB_index())
            if found := foot_of.get(bodies):
                foot, sign = found
                forces[foot] += sign * float(pair.contact_force()[2])
        patches = self._has_patches and results.num_hydroelastic_contacts()
        for i in range(patches):
            patch = results.hydroelastic_contact_info(i)
            surface = patch.contact_surface()
            bodies = (
                self._body_of[surface.id_M()],
                self._body_of[surface.id_N()],
            )
            if found := foot_of.get(bodies):
                foot, sign = found
                forces[foot] -= sign * patch.F_Ac_W().translational()[2]
        return forces
