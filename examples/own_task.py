"""A task of one's own in the whole-body QP bends an elbow by a PD law."""

import numpy as np

import nadia_balance as nb


class Elbow:
    """Wants an acceleration of one joint, with a weight against others."""

    name, weight = "elbow", 5.0

    def __init__(self, robot, joint, angle):
        plant = robot.control_plant()
        self.i = plant.GetJointByName(joint).velocity_start()
        self.rows = np.eye(plant.num_velocities() + 1)[[self.i]]  # [J, b]
        self.angle = angle  # [rad]

    def motion(self, terms, command):
        error = self.angle - terms.q[1 + self.i]  # q begins with a quaternion
        vdot = 100.0 * error - 20.0 * terms.v[self.i]
        return nb.Motion(self.rows, np.array([vdot]))


mine = Elbow(nb.load_robot("nadia"), "LEFT_ELBOW_Y", -1.2)
diagram = nb.HumanoidDiagram(nb.load_scenario("stand"), tasks=[mine])
run = nb.simulate(diagram, 2.0)
elbow = diagram.plant.GetJointByName("LEFT_ELBOW_Y").position_start()
print(f"elbow at {run.logs['state'][-1, elbow]:.2f} rad")
