"""A biped that nobody has seen, written as people write URDFs.

Links have frames turned at random, the base axes in an order of its own.  There
are no transmissions, but massless frames, <gazebo> tags and tapered soles.
"""

from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import SubElement

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from nadia_balance.new_robot.description import Notes
from nadia_balance.new_robot.make import make_robot
from tests import run_cache

X, Y, Z = np.eye(3)
LEFT, RIGHT = 1.0, -1.0


@dataclass
class Biped:
    """Its figures [m], of a robot that stands upright with straight legs.

    But for its knees, which the file may show bent.
    """

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
    knee_range: tuple[float, float] = (0.0, 2.3)  # from straight [rad]
    drawn_bend: float = 0.0  # of the knee at angle 0 [rad]
    foot_ahead: float = 0.03  # its centre of mass, of the ankle
    hip_slant: float = 0.0  # of the pitch axis, up at its outer end [rad]
    drawn_apart: float = 0.0  # of the legs at angle 0, by the rolls [rad]
    toes_out: float = 0.0  # of the legs at angle 0, by the yaws [rad]
    # Rows: forward, left, up in the base's axes; None: as they should be.
    base_axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    turned: bool = True  # the frames of the links
    rods: bool = False  # on each shin, which follow the ankle
    footprint: bool = False  # a root without mass on the ground, as of ROS
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
        heel = self.heel, self.heel_half_width
        toe = self.toe, self.toe_half_width
        return [
            (x, y, z)
            for x, width in (heel, toe)
            for y in (width, -width)
            for z in (-self.ankle, -self.ankle + 0.04)
        ]

    def _sole(self, link: str) -> trimesh.Trimesh:
        corners = self._frames[link].inv().apply(self.corners())
        return trimesh.convex.convex_hull(corners)

    def _upper_body(self) -> None:
        self._link("pelvis", 10.0, (0.0, 0.0, 0.05), 0.1)
        if self.footprint:
            self._frames["base_footprint"] = self._frame("pelvis")
            self._link("base_footprint", 0.0)
            at = (0.0, 0.0, self.thigh + self.shin + self.ankle)
            self._joint("on_ground", "base_footprint", "pelvis", at)
        self._link("spine", 0.0)
        self._joint("waist", "pelvis", "spine", (0, 0, 0.1), Z)
        self._link("chest", 20.0, (0.0, 0.0, 0.25), 0.15)
        self._joint("bow", "spine", "chest", (0, 0, 0), Y)
        self._link("imu", 0.0)
        self._joint("imu_mount", "chest", "imu", (0.1, 0, 0.1))
        for side, n in (LEFT, "l"), (RIGHT, "r"):
            arm, at = f"{n}_arm", (0, 0.26 * side, 0.35)
            self._link(arm, 3.0, (0, 0, -0.2), 0.04)
            self._joint(f"{n}_swing", "chest", arm, at, Y)
            self._link(f"{n}_thumb", 0.1, (0, 0, 0), 0.01)
            grip = self._joint(f"{n}_grip", arm, f"{n}_thumb", (0, 0, -0.4), X)
            SubElement(grip, "mimic", joint=f"{n}_swing")
            self._link(f"{n}_palm", 0.2, (0, 0, 0), 0.02)
            slide = f"{n}_slide", arm, f"{n}_palm", (0, 0, -0.35), Z
            self._joint(*slide, kind="prismatic")

    def _leg(self, side: float, n: str) -> None:
        down = (0.0, 0.0, 0.0)
        drawn, slant = self.drawn_bend, self.hip_slant
        below = np.array(
            [
                (0.0, 0.0, -self.thigh),
                (-self.shin * np.sin(drawn), 0.0, -self.shin * np.cos(drawn)),
            ]
        )
        middle = 0.5 * below
        bent = sorted(self.knee_sign * (e - drawn) for e in self.knee_range)
        bend, roll = self.knee_sign * Y, (-self.ankle_roll, self.ankle_roll)
        pitch = np.cos(slant) * Y + side * np.sin(slant) * Z
        bow = (-1.0 + drawn, 0.7 + drawn)
        # Angles at which the file draws what stands upright.
        zeros = {
            "yaw": side * self.toes_out * Z,
            "roll": side * self.drawn_apart * X,
        }
        foot = (self.foot_ahead, 0.0, -0.06)
        holder = "pelvis"
        for link, mass, com, radius, joint, at, axis, limits in (
            ("1", 1.0, down, 0.03, "yaw", (0, self.hip * side, 0), Z, None),
            ("2", 1.0, down, 0.03, "roll", down, X, (-0.6, 0.6)),
            ("thigh", 6.0, middle[0], 0.06, "hip", down, pitch, (-2.0, 1.0)),
            ("shin", 4.0, middle[1], 0.05, "knee", below[0], bend, bent),
            ("5", 0.3, down, 0.02, "ankle", below[1], Y, bow),
            ("foot", 1.5, foot, 0.0, "tilt", down, X, roll),
            ("sole", 0.0, down, 0.0, "sole_frame", (0, 0, -0.1), None, None),
        ):
            name = f"{n}_{link}"
            element = self._link(name, mass, com, radius)
            turn = zeros.get(joint, np.zeros(3))
            self._joint(
                f"{n}_{joint}", holder, name, at, axis, limits, turn=turn
            )
            holder = name
            if link == "foot":
                file = f"package://biped_description/meshes/{n}_foot.stl"
                _show(element, "mesh", filename=file)
        if self.rods:
            self._link(f"{n}_rod", 0.2, (0.0, 0.0, 0.1), 0.01)
            rod = self._joint(f"{n}_rod", f"{n}_shin", f"{n}_rod", below[1], Y)
            SubElement(rod, "mimic", joint=f"{n}_ankle")

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
            for shape in _show(link, "sphere", radius=str(radius)):
                SubElement(shape, "origin", xyz=at)
        return link

    def _joint(
        self,
        name,
        holder,
        child,
        at,
        axis=None,
        limits=None,
        kind="",
        turn=(0.0, 0.0, 0.0),
    ):
        held, hanging = self._frame(holder), self._frame(child)
        drawn = Rotation.from_rotvec(turn)  # at angle 0
        kind = kind or ("fixed" if axis is None else "revolute")
        joint = SubElement(self._top, "joint", name=name, type=kind)
        rpy = _text((held.inv() * drawn * hanging).as_euler("xyz"))
        SubElement(joint, "origin", xyz=_text(held.inv().apply(at)), rpy=rpy)
        SubElement(joint, "parent", link=holder)
        SubElement(joint, "child", link=child)
        if axis is not None:
            SubElement(joint, "axis", xyz=_text(hanging.inv().apply(axis)))
            lower, upper = map(str, limits or (-1.5, 1.5))
            drive = {"effort": "250", "velocity": "12"}
            SubElement(joint, "limit", drive, lower=lower, upper=upper)
        return joint


def make_once(file: Path, folder: Path, **options) -> Notes:
    """`make_robot`, whose notes and files are kept on disk, see run_cache.

    They follow from the files beside `file`; no path of a run may be in them.
    """

    def make() -> tuple[Notes, dict[Path, bytes]]:
        notes = make_robot(file, folder, **options)
        return notes, {Path(n): data for n, data in _files_in(folder)}

    here = file.parent
    given = [*_files_in(here), str(options).replace(str(here.resolve()), "")]
    notes, files = run_cache.once(__name__, str(given), make)
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return notes


def _files_in(folder: Path) -> list[tuple[str, bytes]]:
    paths = sorted(filter(Path.is_file, folder.rglob("*")))
    return [(str(p.relative_to(folder)), p.read_bytes()) for p in paths]


def _show(link, solid: str, **size: str) -> list:
    """Gives `link` a visual and a collision shape."""
    shapes = [SubElement(link, kind) for kind in ("visual", "collision")]
    for shape in shapes:
        SubElement(SubElement(shape, "geometry"), solid, size)
    return shapes


def _text(values) -> str:
    return " ".join(f"{value:.12f}" for value in values)
