"""A learned policy walks the G1 in the place of the controller, pushed.

python examples/policy.py FILE.onnx   # docs/policy.md says where there is one
"""

import sys

import nadia_balance as nb

scenario = nb.load_scenario("push", robot="g1", duration=12.0)
scenario = scenario.with_push("inward", delta_v=0.4, at="8 s")
robot = nb.load_robot("g1")
policy = nb.PolicyController(robot, sys.argv[1])
command = nb.VelocityCommands([(0.5, 0.3, 0.0, 0.0)])  # [s], [m/s], [rad/s]
diagram = nb.HumanoidDiagram(
    scenario, controller=policy, sources={"velocity_command": command}
)
run = nb.simulate(diagram)
print(run.fall_reason or "It keeps its feet.")
