"""A biped that nobody has seen, written as people write URDFs.

Every link has a frame of its own, turned at random; that of the base has its
axes in an order of its own.  No transmissions, frames without mass, <gazebo>
tags, soles from meshes of a package, tapered, and shapes that are rounded.
"""

from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import SubElement

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

X, Y, Z = np.eye(3)
LEFT, RIGHT = 1.0, -1.0


@dataclass
class Biped:
    """Its figures, of a robot that stands upright with straight legs [m]."""

    hip: float = 0.13  # lateral, from the middle
    thigh: float = 0.4
    shin: float = 0.38
    ankle: float = 0.09  # above the sole
    heel: float = -0.07
    toe: float = 0.17
    heel_half_width: float = 0.05
    toe_half_width: float = 0.06
    ankle_roll: float = 0.5  # either way [rad]
    knee_sign: float = 1.0
    # Rows: forward, left, up in the base's axes; None: as they should be.
    base_axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    turned: bool = True  # the frames of the links
    seed: int = 0

    def write(self, folder: Path) -> Path:
        """Writes biped.urdf and the package with its meshes."""
        self._rng = np.random.default_rng(self.seed)
        self._top = ElementTree.Element("robot", name="biped")
        self._frames = {"": Rotation.identity()}
        self._upper_body()
        for side, name in (LEFT, "l"), (RIGHT, "r"):
            self._leg(side, name)
        SubElement(self._top, "gazebo", reference="pelvis")
        meshes = folder / "biped_description" / "meshes"
        meshes.mkdir(parents=True)
        for name in "lr":
            self._sole(f"{name}_foot").export(meshes / f"{name}_foot.stl")
        file = folder / "biped.urdf"
        ElementTree.indent(self._top)
        ElementTree.ElementTree(self._top).write(file)
        return file

    def corners(self) -> list:
        """Of the sole, under the ankle; the foot is 4 cm thick."""
        ends = (
            (self.heel, self.heel_half_width),
            (self.toe, self.toe_half_width),
        )
        return [
            (x, sign * width, z)
            for x, width in ends
            for sign in (1.0, -1.0)
            for z in (-self.ankle, -self.ankle + 0.04)
        ]

    def _sole(self, link: str) -> trimesh.Trimesh:
        corners = self._frames[link].inv().apply(self.corners())
        return trimesh.convex.convex_hull(corners)

    def _upper_body(self) -> None:
        self._link("pelvis", 10.0, (0.0, 0.0, 0.05), 0.1)
        self._joint("waist", "pelvis", "spine", (0, 0, 0.1), Z)
        self._link("spine", 0.0)
        self._joint("bow", "spine", "chest", (0, 0, 0), Y)
        self._link("chest", 20.0, (0.0, 0.0, 0.25), 0.15)
        self._joint("imu_mount", "chest", "imu", (0.1, 0, 0.1))
        self._link("imu", 0.0)
        for side, name in (LEFT, "l"), (RIGHT, "r"):
            at = (0, 0.26 * side, 0.35)
            self._joint(f"{name}_swing", "chest", f"{name}_arm", at, Y)
            self._link(f"{name}_arm", 3.0, (0, 0, -0.2), 0.04)
            grip = self._joint(
                f"{name}_grip", f"{name}_arm", f"{name}_thumb", (0, 0, -0.4), X
            )
            SubElement(grip, "mimic", joint=f"{name}_swing")
            self._link(f"{name}_thumb", 0.1, (0, 0, 0), 0.01)
            self._joint(
                f"{name}_slide",
                f"{name}_arm",
                f"{name}_palm",
                (0, 0, -0.35),
                Z,
                kind="prismatic",
            )
            self._link(f"{name}_palm", 0.2, (0, 0, 0), 0.02)

    def _leg(self, side: float, n: str) -> None:
        down = (0.0, 0.0, 0.0)
        self._joint(f"{n}_yaw", "pelvis", f"{n}_1", (0, self.hip * side, 0), Z)
        self._link(f"{n}_1", 1.0, down, 0.03)
        self._joint(f"{n}_roll", f"{n}_1", f"{n}_2", down, X, (-0.6, 0.6))
        self._link(f"{n}_2", 1.0, down, 0.03)
        self._joint(f"{n}_hip", f"{n}_2", f"{n}_thigh", down, Y, (-2.0, 1.0))
        self._link(f"{n}_thigh", 6.0, (0, 0, -0.5 * self.thigh), 0.06)
        bent = (0.0, 2.3) if self.knee_sign > 0.0 else (-2.3, 0.0)
        self._joint(
            f"{n}_knee",
            f"{n}_thigh",
            f"{n}_shin",
            (0, 0, -self.thigh),
            self.knee_sign * Y,
            bent,
        )
        self._link(f"{n}_shin", 4.0, (0, 0, -0.5 * self.shin), 0.05)
        self._joint(
            f"{n}_ankle",
            f"{n}_shin",
            f"{n}_5",
            (0, 0, -self.shin),
            Y,
            (-1, 0.7),
        )
        self._link(f"{n}_5", 0.3, down, 0.02)
        roll = self.ankle_roll
        self._joint(f"{n}_tilt", f"{n}_5", f"{n}_foot", down, X, (-roll, roll))
        foot = self._link(f"{n}_foot", 1.5, (0.03, 0, -0.06), 0.0)
        for kind in ("visual", "collision"):
            geometry = SubElement(SubElement(foot, kind), "geometry")
            name = f"package://biped_description/meshes/{n}_foot.stl"
            SubElement(geometry, "mesh", filename=name)
        self._joint(f"{n}_sole_frame", f"{n}_foot", f"{n}_sole", (0, 0, -0.1))
        self._link(f"{n}_sole", 0.0)

    def _frame(self, link: str) -> Rotation:
        """From the link's axes to forward, left, up."""
        if link not in self._frames:
            self._frames[link] = (
                Rotation.from_matrix(self.base_axes.T).inv()
                if link == "pelvis"
                else Rotation.random(random_state=self._rng)
                if self.turned
                else Rotation.identity()
            )
        return self._frames[link]

    def _link(self, name, mass, com=(0.0, 0.0, 0.0), radius=0.0):
        link = SubElement(self._top, "link", name=name)
        at = _text(self._frame(name).inv().apply(com))
        if mass:
            inertial = SubElement(link, "inertial")
            SubElement(inertial, "origin", xyz=at)
            SubElement(inertial, "mass", value=str(mass))
            moment = str(0.4 * mass * max(radius, 0.03) ** 2)
            diagonal = dict.fromkeys(("ixx", "iyy", "izz"), moment)
            SubElement(inertial, "inertia", diagonal)
        if radius:
            for kind in ("visual", "collision"):
                shape = SubElement(link, kind)
                SubElement(shape, "origin", xyz=at)
                geometry = SubElement(shape, "geometry")
                SubElement(geometry, "sphere", radius=str(radius))
        return link

    def _joint(
        self,
        name,
        parent,
        child,
        at,
        axis=None,
        limits=(-1.5, 1.5),
        kind="revolute",
    ):
        held, hanging = self._frame(parent), self._frame(child)
        kind = kind if axis is not None else "fixed"
        joint = SubElement(self._top, "joint", name=name, type=kind)
        rpy = (held.inv() * hanging).as_euler("xyz")
        SubElement(
            joint, "origin", xyz=_text(held.inv().apply(at)), rpy=_text(rpy)
        )
        SubElement(joint, "parent", link=parent)
        SubElement(joint, "child", link=child)
        if axis is not None:
            SubElement(joint, "axis", xyz=_text(hanging.inv().apply(axis)))
            lower, upper = map(str, limits)
            SubElement(
                joint,
                "limit",
                lower=lower,
                upper=upper,
                effort="250",
                velocity="12",
            )
        return joint


def _text(values) -> str:
    return " ".join(f"{value:.12f}" for value in values)
