"""What a description says and no robot is: mended, warned of or refused."""

import itertools
import re
from collections.abc import Sequence

import numpy as np
import trimesh
from pydrake.multibody.tree import SpatialInertia, UnitInertia

from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.new_robot import Notes
from nadia_balance.new_robot.anatomy import Anatomy, Leg
from nadia_balance.new_robot.description import Array, Description
from nadia_balance.new_robot.shapes import Z_UP, Shape

# Mass over the cubed length of the legs, of any humanoid [kg/m^3].
_DENSITY = (20.0, 2000.0)
# Share of their mean by which left and right may differ, and the largest moment
# of inertia over mass times the square of the farthest point of a shape [-].
_UNLIKE, _LARGEST = 0.2, 2.0
_SIDES = {"l": 1, "left": 1, "r": -1, "right": -1}
_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")


def check_units(robot: Description, legs: Sequence[Leg]) -> None:
    """Raises ValueError for a robot far too heavy or light for its legs."""
    poses, mass = robot.poses(), robot.mass(robot.links)
    at = [poses[robot.joints[n].child].translation() for n in legs[0].joints]
    length = sum(np.linalg.norm(b - a) for a, b in itertools.pairwise(at))
    least, most = (density * length**3 for density in _DENSITY)
    if not least < mass < most:
        raise ValueError(
            f"mass = {mass:.4g} kg, with legs of {length:.4g} m: must be in "
            f"({least:.3g}, {most:.3g}) kg; units are kg and m"
        )


def mend_shapes(robot: Description, notes: Notes) -> None:
    """Drops shapes that cannot be read, and puts Collada's meshes upright.

    Some programs heed the up axis of a Collada file and some do not, so that
    it is heeded here if the centres of mass are nearer to the meshes' then.
    """
    turned: list[Shape] = []
    nearer, missing = 0.0, robot.mended.missing
    for body in itertools.chain(*robot.links.values()):
        name, com = body.name(), body.default_com()
        shapes = robot.mended.shapes.get(name, [])
        for shape in list(shapes):
            try:
                middle = shape.mesh.bounds.mean(axis=0)
            except ValueError as error:
                shapes.remove(shape)
                missing.setdefault(name, str(error))
                where = f"{shape.role} of link {name}"
                notes.changed.append(f"left out {where}: {error}")
                continue
            if shape.y_up:
                turned.append(shape)
                p_GC = shape.X_LG.inverse() @ com
                nearer += np.linalg.norm(p_GC - middle)
                nearer -= np.linalg.norm(p_GC - Z_UP @ middle)
    if nearer > 0.0:
        notes.changed.append(
            f"turned {len(turned)} meshes, of which the files say: y is up"
        )
        for shape in turned:
            shape.X_LG = shape.X_LG @ Z_UP


def mend_inertias(robot: Description, notes: Notes) -> None:
    """Gives links without moments of inertia those of a box of their size."""
    boxed = []
    for body in itertools.chain(*robot.links.values()):
        shapes = robot.mended.shapes.get(body.name(), [])
        if body.name() in robot.mended.pointlike and shapes:
            com, mass = body.default_com(), body.default_mass()
            box = UnitInertia.SolidBox(*np.ptp(_corners(shapes), axis=0))
            M = SpatialInertia(mass, com, box.ShiftFromCenterOfMass(com))
            robot.set_inertia(body, M)
            boxed.append(body.name())
    if boxed:
        notes.changed.append(
            f"moments of inertia of 0, now of a box: {', '.join(boxed)}"
        )


def _corners(shapes: Sequence[Shape]) -> Array:
    """The corners (k, 3) of the boxes about shapes, in their link."""
    return np.concatenate(
        [
            (shape.X_LG @ trimesh.bounds.corners(shape.mesh.bounds).T).T
            for shape in shapes
        ]
    )


def doubt(robot: Description, anatomy: Anatomy, notes: Notes) -> None:
    """Warns of inertias of no body, of unlike sides and of swapped names."""
    large = []
    for link in robot.links:
        inertia = robot.inertia(link)
        mass, com = inertia.get_mass(), inertia.get_com()
        if shapes := robot.shapes(link):
            far = np.linalg.norm(_corners(shapes) - com, axis=1).max()
            central = inertia.Shift(com).CalcRotationalInertia()
            largest = central.CalcPrincipalMomentsOfInertia().max()
            if largest > _LARGEST * mass * far**2:
                large.append(link)
    if large:
        notes.warning.append(
            "moments of inertia too large for the mass and the shapes: "
            + ", ".join(large)
        )
    _doubt_symmetry(robot, anatomy, notes)
    wrong = [
        name
        for side, leg in anatomy.legs.items()
        for name in (leg.foot, *leg.joints)
        if any(
            _SIDES.get(word.lower()) == -side.sign
            for word in _WORDS.findall(name)
        )
    ]
    if wrong:
        notes.warning.append(
            "left and right swapped? Where left is, seen forward, are "
            f"links and joints of the other name: {', '.join(wrong)}"
        )


def _doubt_symmetry(robot: Description, anatomy: Anatomy, notes: Notes) -> None:
    """Warns of legs whose links or joints are unlike."""
    left, right = (anatomy.legs[side].joints for side in Side)
    unlike = []
    for pair in zip(left, right, strict=True):
        joints = [robot.joints[name] for name in pair]
        links = [joint.child for joint in joints]
        masses = [robot.mass([link]) for link in links]
        efforts = [joint.effort for joint in joints]
        spans = [joint.upper - joint.lower for joint in joints]
        for what, unit, names, (a, b) in (
            ("mass", "kg", links, masses),
            ("effort limit", "N m", pair, efforts),
            ("range", "rad", pair, spans),
        ):
            if abs(a - b) > _UNLIKE * 0.5 * (a + b):
                unlike.append(
                    f"{what} of {' and '.join(names)}: {a:.3g} and {b:.3g} "
                    + unit
                )
    if unlike:
        notes.warning.append("left and right differ: " + "; ".join(unlike))
