"""A plant, the controller, Meshcat and a push, connected in a Diagram."""

from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.visualization import AddDefaultVisualization

import nadia_balance as nb

robot, params = nb.load_robot("nadia"), nb.controller_params("nadia")
start = nb.walking_start(nb.Gait(num_steps=10), robot.point_mass)
shove = nb.Push(delta_v=0.4, direction_deg=90.0, at="right swing 25 %")
builder, period = DiagramBuilder(), params.control_period
plant, _ = robot.add_plant_to(builder)
controller = builder.AddSystem(nb.BalanceController(params, robot, start=start))
sensor = builder.AddSystem(nb.FootForceSensor(plant, robot, period))
push = nb.PushSource([shove], robot.mass, period, plant, robot.pelvis_body)
builder.AddSystem(push)
nb.connect(builder, plant, controller, state="estimated_state")
nb.connect(builder, plant, sensor, "contact_results")
nb.connect(builder, sensor, controller, "foot_forces")
nb.connect(builder, controller, plant, "actuation")
nb.connect(builder, controller, push, "walking_state")
nb.connect(builder, push, plant, spatial_forces="applied_spatial_force")
AddDefaultVisualization(builder, Meshcat(MeshcatParams(host="localhost")))
simulator = Simulator(builder.Build())
simulator.AdvanceTo(5.0)
context = plant.GetMyContextFromRoot(simulator.get_context())
print(f"pelvis at {plant.GetPositions(context)[6]:.3f} m")
