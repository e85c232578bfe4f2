"""Springs in all joints, which never step: the floor of any comparison.

A joint is at its effort limit 0.1 rad from the standing posture.  As a row:
envelope.py --protocol push-v1 --controller examples.null_controller:Springs
"""

import numpy as np
from pydrake.systems.framework import LeafSystem

import nadia_balance as nb


class Springs(LeafSystem):
    def __init__(self, robot):
        super().__init__()
        plant = robot.control_plant()
        self.nq, self.q = plant.num_positions(), robot.standing_positions()
        self.B = plant.MakeActuationMatrix()[6:]  # joints from actuators
        self.most = np.array(
            [
                plant.get_joint_actuator(i).effort_limit()
                for i in plant.GetJointActuatorIndices()
            ]
        )  # [N m]
        size = plant.num_multibody_states()
        self.state = self.DeclareVectorInputPort("estimated_state", size)
        self.DeclareVectorOutputPort("actuation", len(self.most), self.calc)

    def calc(self, context, output):
        q, v = np.split(self.state.Eval(context), [self.nq])
        error = (self.q - q)[7:] - 0.025 * v[6:]  # [rad], [s]
        tau = 10.0 * self.most * (self.B.T @ error)
        output.SetFromVector(np.clip(tau, -self.most, self.most))


if __name__ == "__main__":
    mine = Springs(nb.load_robot("nadia"))
    scenario = nb.load_scenario("push_standing")  # 0.3 m/s forward
    run = nb.simulate(nb.HumanoidDiagram(scenario, controller=mine), 3.0)
    print(run.fall_reason or "It keeps its feet.")
