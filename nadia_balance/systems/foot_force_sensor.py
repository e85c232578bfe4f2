"""How much weight each foot carries."""

from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.walking import Side
from nadia_balance.robot import RobotModel


class FootForceSensor(LeafSystem):
    """Sums the contact forces on each foot.

    `foot_forces` (left, right) [N] is the component along z of W, which is
    the normal force on level ground, and never negative.  Point and
    hydroelastic contact both count; contact among the robot's own bodies
    does not.

    .. pydrake_system::

        name: FootForceSensor
        input_ports: [contact_results]
        output_ports: [foot_forces]
    """

    def __init__(self, plant: MultibodyPlant, robot: RobotModel):
        """Senses the feet of `robot` in the simulated `plant`."""
        super().__init__()
        bodies = [
            plant.GetBodyByName(robot.foot_bodies[side])
            for side in (Side.LEFT, Side.RIGHT)
        ]
        self._row = {int(body.index()): i for i, body in enumerate(bodies)}
        self._own_bodies = {
            int(index)
            for body in bodies
            for index in plant.GetBodyIndices(body.model_instance())
        }
        self._body_of = {
            geometry: index
            for index in self._own_bodies
            for geometry in plant.GetCollisionGeometriesForBody(
                plant.get_body(BodyIndex(index))
            )
        }
        self._contact_results = self.DeclareAbstractInputPort(
            "contact_results", AbstractValue.Make(ContactResults())
        )
        self.DeclareVectorOutputPort("foot_forces", 2, self._calc)

    def _calc(self, context, output):
        results = self._contact_results.Eval(context)
        forces = [0.0, 0.0]
        for i in range(results.num_point_pair_contacts()):
            pair = results.point_pair_contact_info(i)
            f_z = pair.contact_force()[2]  # on B
            a, b = int(pair.bodyA_index()), int(pair.bodyB_index())
            self._add(forces, a, b, f_z)
        for i in range(results.num_hydroelastic_contacts()):
            patch = results.hydroelastic_contact_info(i)
            surface = patch.contact_surface()
            f_z = -patch.F_Ac_W().translational()[2]  # on A, so -f is on B
            a = self._body_of.get(surface.id_M(), -1)
            b = self._body_of.get(surface.id_N(), -1)
            self._add(forces, a, b, f_z)
        output.SetFromVector([max(force, 0.0) for force in forces])

    def _add(self, forces: list[float], a: int, b: int, f_z: float) -> None:
        """Books the force `f_z` that the body `a` exerts on the body `b`."""
        if a in self._own_bodies and b in self._own_bodies:
            return
        if b in self._row:
            forces[self._row[b]] += f_z
        elif a in self._row:
            forces[self._row[a]] -= f_z
