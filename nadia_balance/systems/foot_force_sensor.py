"""How much weight each foot carries."""

from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import (
    ContactModel,
    ContactResults,
    MultibodyPlant,
)
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.walking import Side
from nadia_balance.robot import RobotModel


class FootForceSensor(LeafSystem):
    """Measures the force on each foot once a period, and holds it.

    `foot_forces` (left, right) [N] is the component along z of W, which is
    the normal force on level ground, and never negative.  Contact among the
    robot's own bodies does not count.  The output is the discrete state.

    .. pydrake_system::

        name: FootForceSensor
        input_ports: [contact_results]
        output_ports: [foot_forces]
    """

    def __init__(
        self, plant: MultibodyPlant, robot: RobotModel, period: float
    ):
        """Senses the feet of `robot` in `plant` every `period` [s].

        Raises:
            ValueError: the contacts of `plant` are not point contacts.
        """
        super().__init__()
        if plant.get_contact_model() != ContactModel.kPoint:
            raise ValueError(
                f"contact_model = {plant.get_contact_model().name}: must be "
                "point, which is all that the foot sensor sees"
            )
        feet = [plant.GetBodyByName(robot.foot_bodies[side]) for side in Side]
        self._row = {int(foot.index()): i for i, foot in enumerate(feet)}
        self._own = {
            int(i) for i in plant.GetBodyIndices(feet[0].model_instance())
        }
        self._contact_results = self.DeclareAbstractInputPort(
            "contact_results", AbstractValue.Make(ContactResults())
        )
        state = self.DeclareDiscreteState(len(feet))
        self.DeclareStateOutputPort("foot_forces", state)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._measure
        )

    def _measure(self, context, state):
        results = self._contact_results.Eval(context)
        forces = [0.0] * len(self._row)
        for i in range(results.num_point_pair_contacts()):
            pair = results.point_pair_contact_info(i)
            a, b = int(pair.bodyA_index()), int(pair.bodyB_index())
            if a in self._own and b in self._own:
                continue
            if b in self._row:  # the force is the one on B
                forces[self._row[b]] += pair.contact_force()[2]
            elif a in self._row:
                forces[self._row[a]] -= pair.contact_force()[2]
        state.set_value([max(force, 0.0) for force in forces])
        return EventStatus.Succeeded()
