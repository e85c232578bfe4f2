"""A robot of the package alone on the ground, and what its URDF says."""

from functools import cached_property
from xml.etree import ElementTree

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.robot import RobotModel, terrain_file


class Urdf:
    """A robot's URDF as it is written."""

    def __init__(self, robot: RobotModel):
        self.root = ElementTree.parse(robot.urdf).getroot()
        self.links = [link.get("name") for link in self.root.iter("link")]
        self.joints = [
            joint.get("name")
            for joint in self.root.findall("joint")
            if joint.get("type") != "fixed"
        ]

    def inertial(self, link: str) -> tuple[float, np.ndarray, np.ndarray]:
        """Mass, CoM (3,) and inertia (3, 3) of a link."""
        found = self.root.find(f"link[@name='{link}']/inertial")
        i = {k: float(v) for k, v in found.find("inertia").attrib.items()}
        inertia = [
            [i["ixx"], i["ixy"], i["ixz"]],
            [i["ixy"], i["iyy"], i["iyz"]],
            [i["ixz"], i["iyz"], i["izz"]],
        ]
        com = np.array(found.find("origin").get("xyz").split(), dtype=float)
        mass = float(found.find("mass").get("value"))
        return mass, com, np.array(inertia)


class World:
    """A robot on the flat ground, at the positions q, lifted by a height."""

    def __init__(self, robot: RobotModel, q=None, height=0.0):
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
        robot.add_to(self.plant)
        Parser(self.plant).AddModels(str(terrain_file()))
        self.plant.Finalize()
        self.inspector = scene_graph.model_inspector()
        self._robot = robot
        self._simulator = Simulator(builder.Build())
        if q is not None:
            self.plant.SetPositions(
                self.context, [*q[:6], q[6] + height, *q[7:]]
            )

    @cached_property
    def context(self):
        return self.plant.GetMyMutableContextFromRoot(
            self._simulator.get_mutable_context()
        )

    def set_angle(self, joint: str, angle: float) -> None:
        self.plant.GetJointByName(joint).set_angle(self.context, angle)

    def touching(self) -> list[tuple[str, str]]:
        """The names of the bodies of every pair of shapes that overlap."""
        port = self.plant.get_geometry_query_input_port()
        pairs = port.Eval(self.context).ComputePointPairPenetration()
        return [(self._body(p.id_A), self._body(p.id_B)) for p in pairs]

    def improper_contacts(self) -> set[str]:
        """What the robot says of the contacts of the next millisecond."""
        self._simulator.AdvanceTo(0.001)
        results = self.plant.get_contact_results_output_port().Eval(
            self.context
        )
        return self._robot.improper_contacts(self.plant, results)

    def candidates(self) -> list[tuple[str, str]]:
        """The names of the bodies of every pair of shapes that may touch."""
        pairs = self.inspector.GetCollisionCandidates()
        return [(self._body(a), self._body(b)) for a, b in pairs]

    def _body(self, geometry_id) -> str:
        frame = self.inspector.GetFrameId(geometry_id)
        return self.plant.GetBodyFromFrameId(frame).name()
