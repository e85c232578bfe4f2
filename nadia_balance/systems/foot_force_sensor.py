"""How much weight each foot carries."""

from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import (
    ContactModel,
    ContactResults,
    MultibodyPlant,
)
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.walking import Side
from nadia_balance.robot import RobotModel


class FootForceSensor(LeafSystem):
    """Measures the force on each foot, the mean over the last period.

    `foot_forces` (left, right) [N] is the component along z of W, which is
    the normal force on level ground, and never negative.  Contact among the
    robot's own bodies does not count.  A foot that hits the ground hard
    bounces within one step of the plant, so every step is measured.  The
    output is the first group of the discrete state, the other are the forces
    in the steps of the period, the last one first.

    .. pydrake_system::

        name: FootForceSensor
        input_ports: [contact_results]
        output_ports: [foot_forces]
    """

    def __init__(self, plant: MultibodyPlant, robot: RobotModel, period: float):
        """Senses the feet of `robot` in `plant`, over a `period` [s].

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
        self._row = {int(foot.index()): i for i, foot in enumerate(feet)}
        self._own = {
            int(i) for i in plant.GetBodyIndices(feet[0].model_instance())
        }
        self._has_patches = plant.get_contact_model() != ContactModel.kPoint
        self._body_of = {
            geometry: i
            for i in self._own
            for geometry in plant.GetCollisionGeometriesForBody(
                plant.get_body(BodyIndex(i))
            )
        }
        self._contact_results = self.DeclareAbstractInputPort(
            "contact_results", AbstractValue.Make(ContactResults())
        )
        self._mean = self.DeclareDiscreteState(2)
        self._samples = self.DeclareDiscreteState(2 * self._steps)
        self.DeclareStateOutputPort("foot_forces", self._mean)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=step, offset_sec=0.0, update=self._measure
        )

    def _measure(self, context, state):
        results = self._contact_results.Eval(context)
        forces = [0.0] * len(self._row)
        for i in range(results.num_point_pair_contacts()):
            pair = results.point_pair_contact_info(i)
            a, b = int(pair.bodyA_index()), int(pair.bodyB_index())
            self._add(forces, a, b, pair.contact_force()[2])
        patches = self._has_patches and results.num_hydroelastic_contacts()
        for i in range(patches):
            patch = results.hydroelastic_contact_info(i)
            surface = patch.contact_surface()
            a = self._body_of.get(surface.id_M(), -1)
            b = self._body_of.get(surface.id_N(), -1)
            self._add(forces, a, b, -patch.F_Ac_W().translational()[2])
        last = context.get_discrete_state(self._samples).value().tolist()
        samples = [max(force, 0.0) for force in forces] + last[:-2]
        means = [sum(samples[i::2]) / self._steps for i in range(2)]
        state.set_value(self._samples, samples)
        state.set_value(self._mean, means)
        return EventStatus.Succeeded()

    def _add(self, forces: list[float], a: int, b: int, f_z: float) -> None:
        """Books the force `f_z` that the body `a` exerts on the body `b`."""
        if a in self._own and b in self._own:
            return
        if b in self._row:
            forces[self._row[b]] += f_z
        elif a in self._row:
            forces[self._row[a]] -= f_z
