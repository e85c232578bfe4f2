"""Creation of a robot folder from a URDF or an MJCF."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform

from nadia_balance.core.math.size import NADIA
from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.new_robot import Named, Notes
from nadia_balance.new_robot.anatomy import (
    Anatomy,
    Leg,
    check_leg_joints,
    find_anatomy,
    two_legs,
    vertical,
)
from nadia_balance.new_robot.capsules import fit_capsules
from nadia_balance.new_robot.description import LEAST_MASS, Description, read
from nadia_balance.new_robot.doubts import (
    check_units,
    doubt,
    mend_inertias,
    mend_shapes,
)
from nadia_balance.new_robot.measure import Measurements, measure, set_frames
from nadia_balance.new_robot.shapes import COLLIDING, VISUAL, Array
from nadia_balance.new_robot.soles import SolePlane, larger_sole
from nadia_balance.new_robot.write import robot_fields, write_urdf, write_yaml

# Joints of a tree whose only floating link is the base.
KINDS = ("revolute", "continuous", "prismatic")
# Rotor inertia scales with mass times leg length squared; 0.1 kg m^2 is assumed
# for Nadia and Atlas at 90.9 kg.
_ROTOR_SHARE = 0.1 / (90.9 * NADIA.leg**2)
_SPEED = 12.0  # speed limit of joints without one [rad/s]
_PLAUSIBLE = 25.0  # largest plausible speed limit [rad/s]
_SAME_DEPTH = 0.004  # tolerated difference of the soles' depths [m]


def make_robot(
    file: Path,
    folder: Path,
    *,
    fix: Sequence[str] = (),
    package_roots: Sequence[Path] = (),
    armature: Path | None = None,
    named: Named | None = None,
) -> Notes:
    """Writes robot.urdf, robot.yaml and meshes into `folder`.

    Joints that a regular expression of `fix` matches in full are welded.  Rotor
    inertias are those of the file `armature`, by joint names, if there is one.

    Raises:
        ValueError: the robot is no biped with driven legs; names the link or
            joint.
        OSError: a file cannot be read or written.
    """
    notes, named = Notes(), named or Named()
    robot = read(file, package_roots, notes)
    legs = clean(robot, fix, named, notes)
    check_units(robot, legs)
    mend_shapes(robot, notes)
    mend_inertias(robot, notes)
    anatomy, measured = study(robot, legs, named, notes)
    doubt(robot, anatomy, notes)
    if armature:
        give_armature(robot, armature)
    guess_drives(robot, measured, notes)
    folder.mkdir(parents=True, exist_ok=True)
    shapes = fit_capsules(robot, anatomy, measured, notes)
    write_urdf(robot, anatomy, measured, shapes, folder)
    slow = any(not joint.speed for joint in robot.joints.values())
    speed = _SPEED if slow else None
    fields = robot_fields(robot.name, anatomy, measured, speed)
    write_yaml(folder, fields)
    return notes


def clean(
    robot: Description, fix: Sequence[str], named: Named, notes: Notes
) -> list[Leg]:
    """Welds joints that are not driven, adds masses; returns the legs."""
    asked = _matching(robot, fix, notes)
    fixed = [j.name for j in robot.joints.values() if j.type == "weld"]
    robot.weld(dict.fromkeys(fixed + asked))
    pelvis, legs = two_legs(robot, named)
    check_leg_joints(robot, legs)
    for why, names in _undriven(robot).items():
        if names:
            notes.changed.append(f"welded, {why}: {', '.join(names)}")
            robot.weld(names)
    for joint in robot.joints.values():
        if joint.type == "continuous":
            notes.changed.append(f"{joint.name} turns by +-pi, not for ever")
    if pelvis != robot.root:
        notes.changed.append(f"the floating base is {pelvis}, not {robot.root}")
        robot.reroot(pelvis)
    if light := robot.give_mass():
        names = ", ".join(light)
        notes.changed.append(f"{LEAST_MASS} kg for links of no mass: {names}")
    return legs


def _matching(
    robot: Description, fix: Sequence[str], notes: Notes
) -> list[str]:
    """The joints whose names match one of `fix`."""
    asked: list[str] = []
    for expression in fix:
        try:
            found = [n for n in robot.joints if re.fullmatch(expression, n)]
        except re.error as error:
            raise ValueError(
                f"fix = {expression!r}: must be a regular expression ({error})"
            ) from None
        if not found:
            raise ValueError(f"fix = {expression!r}: must match a joint")
        notes.changed.append(f"welded as asked: {', '.join(found)}")
        asked += found
    return asked


def _undriven(robot: Description) -> dict[str, list[str]]:
    """The joints that cannot be driven, by the reason."""
    mimic, prismatic, weak = (
        "mimic",
        "prismatic",
        "no effort limit, or no range",
    )
    found: dict[str, list[str]] = {mimic: [], prismatic: [], weak: []}
    for joint in robot.joints.values():
        if joint.type not in KINDS:
            raise ValueError(
                f"joint {joint.name}: must not be {joint.type}; must be one of "
                f"{', '.join(KINDS)}"
            )
        if joint.mimics:
            found[mimic].append(joint.name)
        elif joint.type == "prismatic":
            found[prismatic].append(joint.name)
        elif not joint.effort or joint.upper - joint.lower < 1e-3:
            found[weak].append(joint.name)
    return found


def study(
    robot: Description, legs: list[Leg], named: Named, notes: Notes
) -> tuple[Anatomy, Measurements]:
    """Returns anatomy and measured lengths of `robot`; sets its frames."""
    poses, up = robot.poses(), vertical(robot, legs)
    planes = {leg.foot: _sole(robot, leg.foot, up, poses) for leg in legs}
    toes = [
        poses[foot].rotation() @ plane.points.mean(axis=0)
        for foot, plane in planes.items()
    ]
    anatomy = find_anatomy(robot, legs, toes, named, notes)
    soles = {side: planes[foot] for side, foot in anatomy.feet.items()}
    depths = [plane.depth for plane in soles.values()]
    if abs(depths[0] - depths[1]) > _SAME_DEPTH:
        raise ValueError(
            f"soles of {' and '.join(anatomy.feet.values())}: must be alike; "
            f"they are {depths[0]:.3f} and {depths[1]:.3f} m under the ankles"
        )
    flat = set_frames(robot, anatomy, soles)
    for foot, points in zip(anatomy.feet.values(), flat.values(), strict=True):
        length, width = np.ptp(points, axis=0)
        if width > length:
            notes.warning.append(
                f"the sole of {foot} is wider than long, {width:.3f} and "
                f"{length:.3f} m: is it turned?"
            )
    measured = measure(robot, anatomy, flat, float(np.mean(depths)))
    _note_lengths(measured, soles[Side.LEFT], flat[Side.LEFT], notes)
    return anatomy, measured


def _sole(
    robot: Description,
    foot: str,
    up: Array,
    poses: Mapping[str, RigidTransform],
) -> SolePlane:
    """The sole of `foot`; raises ValueError if no shape is flat below."""
    down = -(poses[foot].rotation().inverse() @ up)
    colliding = robot.shapes(foot, COLLIDING)
    if sole := larger_sole(colliding, robot.shapes(foot, VISUAL), down):
        return sole
    bodies = [body.name() for body in robot.links[foot]]
    why = robot.mended.missing
    missing = [why[b] for b in bodies if b in why]
    raise ValueError(
        f"foot {foot}: must have a shape with a flat side below"
        + (f"; {missing[0]}" if missing else "")
    )


def _note_lengths(
    m: Measurements, sole: SolePlane, points: Array, notes: Notes
) -> None:
    size, whole = m.size, np.ptp(points, axis=0)
    notes.guessed += [
        f"sole {size.sole_length:.3f} x {size.sole_width:.3f} m, of "
        f"{whole[0]:.3f} x {whole[1]:.3f} m that the {sole.source} shapes have",
        f"legs {m.legs.length:.3f} m, hips {m.legs.hip_width:.3f} m apart, "
        f"ankles {m.legs.ankle_height:.3f} m high",
        f"CoM {m.com_height:.3f} m high where it stands, the soles "
        f"{m.step_width:.3f} m apart; arms and spine at 0, or near it",
        f"legs reach {m.reach.length:.3f} m forward and back, "
        f"{m.reach.width_max:.3f} m to the side; used up to Nadia's, by size",
    ]


def give_armature(robot: Description, file: Path) -> None:
    """Takes rotor inertias of the joints of the same names in `file`."""
    theirs = read(file, [], Notes()).joints
    known = robot.joints.keys() & theirs.keys()
    if not known:
        raise ValueError(f"armature = {file}: must have joints of the robot")
    for name in known:
        robot.joints[name].rotor_inertia = theirs[name].rotor_inertia


def guess_drives(
    robot: Description, measured: Measurements, notes: Notes
) -> None:
    """Adds missing rotor inertias; notes unknown parameters of the drives."""
    inertia = _ROTOR_SHARE * robot.mass(robot.links) * measured.size.leg**2
    joints = list(robot.joints.values())
    bare = [joint for joint in joints if not joint.rotor_inertia]
    for joint in bare:
        joint.rotor_inertia = inertia
    slow = ", ".join(j.name for j in joints if not j.speed)
    fast = ", ".join(j.name for j in joints if j.speed > _PLAUSIBLE)
    if bare:
        notes.unknown.append(
            f"rotor inertia of {len(bare)} joints: taken as {inertia:.3g} kg "
            "m^2 at the joint, Nadia's by mass and length"
        )
    if slow:
        notes.unknown.append(f"speed limits of {slow}: {_SPEED:g} rad/s")
    if fast:
        notes.unknown.append(
            f"whether {fast} are as fast as is written, > {_PLAUSIBLE:g} rad/s"
        )
    notes.unknown.append(
        "dry friction of joints, which is left out; bandwidth and corner "
        "speed of drives: the defaults of docs/robot_yaml.md"
    )
