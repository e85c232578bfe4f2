"""Creation of a robot folder from a URDF, MJCF or SDF."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.multibody.tree import SpatialInertia

from nadia_balance.core.size import NADIA
from nadia_balance.core.walking import Side
from nadia_balance.new_robot.anatomy import (
    Anatomy,
    Leg,
    Named,
    check_leg_joints,
    find_anatomy,
    two_legs,
    vertical,
)
from nadia_balance.new_robot.capsules import fit_capsules
from nadia_balance.new_robot.figures import Figures, measure, set_frames
from nadia_balance.new_robot.notes import Notes
from nadia_balance.new_robot.read_drake import read_with_drake
from nadia_balance.new_robot.read_urdf import read_urdf
from nadia_balance.new_robot.soles import SolePlane, find_sole
from nadia_balance.new_robot.tree import Tree
from nadia_balance.new_robot.write import write_urdf, write_yaml

# Rotor inertia scales with mass times leg length squared; 0.1 kg m^2 is assumed
# for Nadia and Atlas at 90.9 kg.
_ROTOR_SHARE = 0.1 / (90.9 * NADIA.leg**2)
_SPEED = 12.0  # speed limit of joints without one [rad/s]
_PLAUSIBLE = 25.0  # largest plausible speed limit [rad/s]
_SAME_DEPTH = 0.004  # tolerated difference of the soles' depths [m]
_LEAST_MASS = 0.02  # mass of links without one [kg]


def make_robot(
    file: Path,
    folder: Path,
    *,
    fix: Sequence[str] = (),
    package_roots: Sequence[Path] = (),
    named: Named | None = None,
) -> Notes:
    """Writes robot.urdf, robot.yaml and meshes into `folder`.

    Joints that a regular expression of `fix` matches in full are welded.

    Raises:
        ValueError: the robot is no biped with driven legs; names the link or
            joint.
        OSError: a file cannot be read or written.
    """
    notes, named = Notes(), named or Named()
    tree = _read(file, package_roots, notes)
    legs = clean(tree, fix, named, notes)
    anatomy, figures = study(tree, legs, named, notes)
    guess_drives(tree, figures, notes)
    folder.mkdir(parents=True, exist_ok=True)
    shapes = fit_capsules(tree, anatomy, figures, notes)
    write_urdf(tree, anatomy, figures, shapes, folder)
    slow = any(not joint.speed for joint in tree.joints.values())
    speed = _SPEED if slow else None
    write_yaml(tree, anatomy, figures, speed, folder)
    return notes


def _read(file: Path, roots: Sequence[Path], notes: Notes) -> Tree:
    """Reads the robot of a URDF, or, by Drake's parser, of an MJCF or SDF."""
    with file.open("rb") as start:
        text = start.read(10000)
    if b"<mujoco" in text or b"<sdf" in text:
        return read_with_drake(file, roots, notes)
    return read_urdf(file, roots, notes)


def clean(
    tree: Tree, fix: Sequence[str], named: Named, notes: Notes
) -> list[Leg]:
    """Welds joints that are not driven, adds masses; returns the legs."""
    for expression in fix:
        try:
            found = [n for n in tree.joints if re.fullmatch(expression, n)]
        except re.error as error:
            raise ValueError(
                f"fix = {expression!r}: must be a regular expression ({error})"
            ) from None
        if not found:
            raise ValueError(f"fix = {expression!r}: must match a joint")
        for name in found:
            tree.joints[name].type = "fixed"
        notes.changed.append(f"welded as asked: {', '.join(found)}")
    _weld(tree, [j.name for j in tree.joints.values() if j.type == "fixed"])
    _drop_world(tree)
    pelvis, legs = two_legs(tree, named)
    check_leg_joints(tree, legs)
    for why, names in _undriven(tree).items():
        if names:
            notes.changed.append(f"welded, {why}: {', '.join(names)}")
            _weld(tree, names)
    for joint in tree.joints.values():
        if joint.type == "continuous":
            notes.changed.append(f"{joint.name} turns by +-pi, not for ever")
    if pelvis != tree.root:
        notes.changed.append(f"the floating base is {pelvis}, not {tree.root}")
        tree.reroot(pelvis)
    _give_mass(tree, notes)
    return legs


def _weld(tree: Tree, names: Sequence[str]) -> None:
    for name in names:
        tree.weld(tree.joints[name])


def _drop_world(tree: Tree) -> None:
    """Removes a massless root that holds the robot by a floating joint."""
    joints = tree.children(tree.root)
    if len(joints) == 1 and joints[0].type == "floating":
        if tree.links[tree.root].mass:
            raise ValueError(f"joint {joints[0].name}: must not be floating")
        del tree.links[tree.root], tree.joints[joints[0].name]
        tree.root = joints[0].child
    for joint in tree.joints.values():
        if joint.type in ("floating", "planar"):
            raise ValueError(
                f"joint {joint.name}: must not be {joint.type}; only one link "
                "floats, the base"
            )


def _undriven(tree: Tree) -> dict[str, list[str]]:
    joints = list(tree.joints.values())
    mimics = [j for j in joints if j.mimics]
    prismatic = [j for j in joints if j.type == "prismatic"]
    weak = [j for j in joints if not j.effort or j.upper - j.lower < 1e-3]
    return {
        "mimic": [j.name for j in mimics],
        "prismatic": [j.name for j in prismatic if j not in mimics],
        "no effort limit, or no range": [
            j.name for j in weak if j not in mimics + prismatic
        ],
    }


def _give_mass(tree: Tree, notes: Notes) -> None:
    light = [link for link in tree.links.values() if not link.mass]
    for link in light:
        link.inertia = SpatialInertia.SolidSphereWithMass(_LEAST_MASS, 0.02)
    if light:
        names = ", ".join(link.name for link in light)
        notes.changed.append(f"{_LEAST_MASS} kg for links of no mass: {names}")


def study(
    tree: Tree, legs: list[Leg], named: Named, notes: Notes
) -> tuple[Anatomy, Figures]:
    """Returns anatomy and measured lengths of `tree`; sets its frames."""
    poses, up = tree.poses(), vertical(tree, legs)
    planes = [
        find_sole(
            tree.links[leg.foot], -(poses[leg.foot].rotation().inverse() @ up)
        )
        for leg in legs
    ]
    toes = [
        poses[leg.foot].rotation() @ plane.points.mean(axis=0)
        for leg, plane in zip(legs, planes, strict=True)
    ]
    anatomy = find_anatomy(tree, tree.root, legs, toes, named, notes)
    by_foot = dict(zip((leg.foot for leg in legs), planes, strict=True))
    soles = {side: by_foot[foot] for side, foot in anatomy.feet.items()}
    depths = [plane.depth for plane in soles.values()]
    feet = " and ".join(anatomy.feet.values())
    if abs(depths[0] - depths[1]) > _SAME_DEPTH:
        raise ValueError(
            f"soles of {feet}: must be alike; they are {depths[0]:.3f} and "
            f"{depths[1]:.3f} m under the ankles"
        )
    flat = set_frames(tree, anatomy, soles)
    figures = measure(tree, anatomy, flat, float(np.mean(depths)))
    say_figures(figures, soles[Side.LEFT], flat[Side.LEFT], notes)
    return anatomy, figures


def say_figures(
    f: Figures, sole: SolePlane, points: np.ndarray, notes: Notes
) -> None:
    """Notes the measured lengths, and the used part of the sole."""
    length, width = f.toe - f.heel, 2.0 * f.half_width
    whole = np.ptp(points, axis=0)
    notes.guessed += [
        f"sole {length:.3f} x {width:.3f} m, of {whole[0]:.3f} x "
        f"{whole[1]:.3f} m that the {sole.source} shapes have",
        f"legs {f.legs.length:.3f} m, hips {f.legs.hip_width:.3f} m apart, "
        f"ankles {f.legs.ankle_height:.3f} m high",
        f"CoM {f.com_height:.3f} m high where it stands, the soles "
        f"{f.step_width:.3f} m apart; arms and spine at 0, or near it",
        f"legs reach {f.reach.length:.3f} m forward and back, "
        f"{f.reach.width_max:.3f} m to the side; used up to Nadia's, by size",
    ]


def guess_drives(tree: Tree, figures: Figures, notes: Notes) -> None:
    """Adds missing rotor inertias; notes unknown parameters of the drives."""
    mass, leg = tree.mass(tree.root), figures.size.leg
    inertia = _ROTOR_SHARE * mass * leg**2
    joints = list(tree.joints.values())
    bare = [joint for joint in joints if not joint.rotor_inertia]
    for joint in bare:
        joint.rotor_inertia = inertia
    if bare:
        notes.unknown.append(
            f"rotor inertia of {len(bare)} joints: taken as {inertia:.3g} kg "
            "m^2 at the joint, Nadia's by mass and length"
        )
    slow = [joint.name for joint in joints if not joint.speed]
    if slow:
        notes.unknown.append(
            f"speed limits of {', '.join(slow)}: {_SPEED:g} rad/s"
        )
    fast = [joint.name for joint in joints if joint.speed > _PLAUSIBLE]
    if fast:
        notes.unknown.append(
            f"whether {', '.join(fast)} are as fast as is written, > "
            f"{_PLAUSIBLE:g} rad/s"
        )
    notes.unknown.append(
        "dry friction of joints, which is left out; bandwidth and corner "
        "speed of drives: the defaults of docs/robot_yaml.md"
    )
