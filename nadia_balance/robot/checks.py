"""Checks of a robot's plant against robot.yaml, and of its contacts."""

import math
from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody import tree
from pydrake.multibody.plant import ContactResults, MultibodyPlant

from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.robot.params import RobotParams
from nadia_balance.robot.plants import actuators, context_at, sole_jacobian
from nadia_balance.robot.plants import joints as all_joints
from nadia_balance.robot.urdf import require


def check_plant(plant: MultibodyPlant, params: RobotParams) -> None:
    """Raises ValueError if `plant` lacks parts that `params` name."""
    for part in ("pelvis", "torso", "left_foot", "right_foot"):
        name = getattr(params, f"{part}_body")
        require(
            plant.HasBodyNamed(name),
            f"{part}_body = {name!r}: must be a link of the URDF",
        )
    bodies = map(plant.get_body, plant.GetFloatingBaseBodies())
    floating = sorted(body.name() for body in bodies)
    require(
        floating == [params.pelvis_body],
        f"pelvis_body = {params.pelvis_body!r}: must be the one link that no "
        f"joint holds; these are: {', '.join(floating) or 'none'}",
    )
    context = plant.CreateDefaultContext()
    left, right = (
        plant.GetBodyByName(foot).EvalPoseInWorld(context).translation()[1]
        for foot in (params.left_foot_body, params.right_foot_body)
    )
    require(
        left > right,
        f"left_foot_body = {params.left_foot_body!r}: must be left of "
        f"right_foot_body = {params.right_foot_body!r}",
    )
    # Joints of one degree of freedom by name, without the floating base.
    joints = {j.name(): j for j in all_joints(plant) if j.num_positions() == 1}
    _check_drives(plant, params, joints)
    for field, angles in (
        ("posture", params.posture),
        ("whole_body.joint_lower_limits", params.whole_body.joint_lower_limits),
        ("whole_body.joint_upper_limits", params.whole_body.joint_upper_limits),
    ):
        for name, angle in angles.items():
            what = f"{field}.{name} = {angle}: must be"
            known = ", ".join(sorted(joints))
            require(name in joints, f"{what} one of the joints {known}")
            low = joints[name].position_lower_limits()[0]
            high = joints[name].position_upper_limits()[0]
            require(low <= angle <= high, f"{what} in [{low}, {high}] rad")


def _check_drives(
    plant: MultibodyPlant, params: RobotParams, joints: dict
) -> None:
    where = f"urdf = {params.urdf}"
    drives = {drive.joint().name(): drive for drive in actuators(plant)}
    for name, joint in joints.items():
        speed = min(joint.velocity_upper_limits()[0], params.max_joint_speed)
        require(
            speed < math.inf,
            f"{where}: joint {name}: must have a velocity limit, or robot.yaml "
            "a max_joint_speed",
        )
        drive = drives.get(name)
        require(
            drive is not None and drive.effort_limit() < math.inf,
            f"{where}: joint {name}: must have an effort limit",
        )
        inertia = drive.default_reflected_inertia()
        require(
            inertia >= 0.0,
            f"{where}: rotor inertia x gear ratio^2 of {name} = {inertia}: "
            "must be >= 0 kg m^2",
        )


def remarks_on(plant: MultibodyPlant, feet: set[str]) -> list[str]:
    """Warnings about legal but suspicious settings of a plant with shapes."""
    remarks = []
    bodies = map(plant.get_body, map(tree.BodyIndex, range(plant.num_bodies())))
    shaped = filter(plant.GetCollisionGeometriesForBody, bodies)
    if {body.name() for body in shaped} == feet:
        remarks.append(
            "only the feet have collision shapes: a fall, or legs in each "
            "other, are not noticed"
        )
    light = [
        drive.joint().name()
        for drive in actuators(plant)
        if not drive.default_reflected_inertia()
    ]
    if light:
        remarks.append(f"no rotor inertia: {', '.join(light)}")
    return remarks


def check_standing(
    plant: MultibodyPlant,
    q: np.ndarray,
    feet: Mapping[Side, str],
    X_FootSole: Mapping[Side, RigidTransform],
) -> None:
    """Raises ValueError if a joint is too weak for the robot to stand.

    The robot of `plant` stands at `q` (nq,), with half of its weight at the
    centre of either sole.
    """
    shares = dict.fromkeys(feet, 0.5)
    torques = standing_torques(plant, q, feet, X_FootSole, shares)
    for drive in actuators(plant):
        joint, limit = drive.joint(), drive.effort_limit()
        needed = abs(torques[joint.velocity_start()])
        require(
            needed <= limit,
            f"effort limit of {joint.name()} = {limit:g}: must be >= "
            f"{needed:.0f} N m, for the robot to stand",
        )


def standing_torques(
    plant: MultibodyPlant,
    q: np.ndarray,
    feet: Mapping[Side, str],
    X_FootSole: Mapping[Side, RigidTransform],
    shares: Mapping[Side, float],
) -> np.ndarray:
    """Returns the torques (nv,) [N m] that hold the robot at `q` (nq,).

    `shares` of its weight are at the centres of the soles.
    """
    context = context_at(plant, q)
    gravity = plant.gravity_field().gravity_vector()
    weight = -plant.CalcTotalMass(context) * gravity
    torques = -plant.CalcGravityGeneralizedForces(context)
    for side, share in shares.items():
        p_FS = X_FootSole[side].translation()
        J = sole_jacobian(plant, context, feet[side], p_FS)
        torques -= share * weight @ J[3:]
    return torques


def improper_contacts(
    plant: MultibodyPlant,
    results: ContactResults,
    robot: tree.ModelInstanceIndex,
    feet: set[str],
) -> set[str]:
    """Returns the pairs of bodies in contact that are not foot and ground.

    Pairs are named, such as "LEFT_SHIN_LINK - RIGHT_SHIN_LINK" or "PELVIS_LINK
    - ground".  A foot may touch all bodies that are not of the `robot`.
    """
    improper = set()
    points = range(results.num_point_pair_contacts())
    infos = map(results.point_pair_contact_info, points)
    for pair in {(int(i.bodyA_index()), int(i.bodyB_index())) for i in infos}:
        bodies = [plant.get_body(tree.BodyIndex(body)) for body in pair]
        own = {b.name() for b in bodies if b.model_instance() == robot}
        # Two robots may have bodies of the same name.
        others = {
            "ground"
            if b.index() == tree.world_index()
            else str(b.scoped_name())
            for b in bodies
            if b.model_instance() != robot
        }
        if own and not (others and own <= feet):
            improper.add(" - ".join([*sorted(own), *others]))
    return improper
