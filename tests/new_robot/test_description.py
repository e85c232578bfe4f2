"""However a robot's description is seen, it stays the robot of the file."""

import re
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from nadia_balance.robot.model import load_robot
from tests.new_robot.biped import Biped, make_once

NAMES = ("waist", "bow", "l_hip", "l_knee", "l_tilt", "r_roll", "r_ankle")
ANGLES = dict(zip(NAMES, (0.3, -0.2, -0.5, 0.8, 0.2, 0.1, -0.4), strict=True))


def seen_by_drake(file, folder):
    """The inertia about a thigh, and the mass matrix of the legs.

    Without shapes, as Drake reads no STL, and without rotors.
    """
    tree = ElementTree.parse(file)
    for holder in list(tree.iter()):
        for part in list(holder):
            if part.tag in ("transmission", "visual", "collision", "mimic"):
                holder.remove(part)
    bare = folder / "bare.urdf"
    tree.write(bare)
    plant = MultibodyPlant(0.001)
    Parser(plant).AddModels(str(bare))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    for name, angle in ANGLES.items():
        plant.GetJointByName(name).set_angle(context, angle)
    thigh = plant.GetFrameByName("r_thigh")
    pelvis = plant.GetBodyByName("pelvis")
    bodies = plant.GetBodyIndices(pelvis.model_instance())
    inertia = plant.CalcSpatialInertia(context, thigh, bodies)
    legs = [
        plant.GetJointByName(f"{n}_{name}").velocity_start()
        for n in "lr"
        for name in ("yaw", "roll", "hip", "knee", "ankle", "tilt")
    ]
    mass_matrix = plant.CalcMassMatrixViaInverseDynamics(context)
    return inertia.CopyToFullMatrix6(), mass_matrix[np.ix_(legs, legs)]


def with_heavy_spine(file):
    """Gives the spine, which has no mass, the inertia of an arm."""
    tree = ElementTree.parse(file)
    arm = tree.find("link[@name='l_arm']/inertial")
    tree.find("link[@name='spine']").append(arm)
    tree.write(file)


def from_spine(file):
    """Begins the file at the spine, on which the pelvis hangs."""
    tree = ElementTree.parse(file)
    waist = tree.find("joint[@name='waist']")
    waist.find("parent").set("link", "spine")
    waist.find("child").set("link", "pelvis")
    waist.find("origin").set("xyz", "0 0 -0.1")
    waist.find("axis").set("xyz", "0 0 -1")
    tree.write(file)


@pytest.mark.parametrize("change", [lambda file: None, from_spine])
def test_the_written_robot_is_the_one_of_the_file(change, tmp_path):
    """Oracle: Drake, which reads the file itself."""
    turned = change is not from_spine
    file = Biped(seed=8, turned=turned).write(tmp_path)
    with_heavy_spine(file)
    before = seen_by_drake(file, tmp_path)
    change(file)
    make_once(file, tmp_path / "made")
    after = seen_by_drake(tmp_path / "made" / "robot.urdf", tmp_path)
    for was, now in zip(before, after, strict=True):
        assert now == pytest.approx(was, rel=1e-6, abs=1e-7)


THIGH, SHIN, HIP, SOLE = 0.4, 0.38, 0.12, (0.24, 0.1)
SMALL = '<geom type="sphere" size="0.03" mass="0.5"/>'
THICK = '<geom type="capsule" size="0.05" fromto="0 0 -0.1 0 0 -0.3" mass="5"/>'
PLATE = (
    f'<geom type="box" size="{0.5 * SOLE[0]} {0.5 * SOLE[1]} 0.02" '
    'pos="0.05 0 -0.06" mass="1"/>'
)
# Position in the parent, axis, range and shape.
LEG = {
    "yaw": ("0 {side} -0.1", "0 0 1", "-1 1", SMALL),
    "roll": ("0 0 0", "1 0 0", "-1 1", SMALL),
    "hip": ("0 0 0", "0 1 0", "-2 1", THICK),
    "knee": (f"0 0 {-THIGH}", "0 1 0", "0 2.2", THICK),
    "ankle": (f"0 0 {-SHIN}", "0 1 0", "-1 0.6", SMALL),
    "tilt": ("0 0 0", "1 0 0", "-0.4 0.4", PLATE),
}


def leg(n: str, side: float) -> str:
    """Six bodies, one in the other."""
    return (
        "".join(
            f'<body name="{n}_{name}" pos="{at.format(side=side)}">'
            f'<joint name="{n}_{name}" axis="{axis}" range="{limits}"/>{shape}'
            for name, (at, axis, limits, shape) in LEG.items()
        )
        + len(LEG) * "</body>"
    )


JOINTS = ["waist", *(f"{n}_{name}" for n in "lr" for name in LEG)]
MOTORS = "".join(
    f'<motor joint="{joint}" ctrllimited="true" ctrlrange="-125 125" gear="2"/>'
    for joint in JOINTS
)
MJCF = f"""
<mujoco model="mj">
<compiler angle="radian" autolimits="true"/>
<default><joint armature="0.02"/></default>
<asset><mesh name="none" file="none.stl"/><material name="m" texture="none"/>
<texture name="none" type="2d" file="none.png"/></asset>
<worldbody>
<geom name="floor" type="plane" size="1 1 1"/>
<body name="pelvis" pos="0 0 1"><freejoint/>
 <geom type="box" size="0.08 0.1 0.08" mass="10"/>
 <geom type="mesh" mesh="none" material="m" contype="0" mass="0"/>
 {leg("l", HIP)}{leg("r", -HIP)}
 <body name="chest" pos="0 0 0.15" euler="0 0 0.3">
  <joint name="waist" axis="0 0 1" range="-1 1" pos="0.02 0.01 0"/>
  <geom type="box" size="0.1 0.15 0.2" pos="0 0 0.2" mass="20"/>
 </body>
</body>
</worldbody>
<contact><pair geom1="floor" geom2="floor"/></contact>
<equality><weld body1="l_tilt" body2="chest" active="false"/></equality>
<actuator>{MOTORS}</actuator>
</mujoco>"""
BOW = '<joint name="bow" axis="0 1 0" pos="0 0 -0.03" range="-1 1"/>'
WITH_BOW = MJCF.replace('<joint name="waist"', BOW + '<joint name="waist"')
WITH_BOW = WITH_BOW.replace(
    "<actuator>",
    '<actuator><adhesion body="pelvis" ctrlrange="0 1" forcerange="0 3"/>'
    '<motor joint="bow" ctrllimited="true" ctrlrange="-9 9"/>',
)


def made(text, folder, name="made"):
    """The notes of the robot of an MJCF, which is made in `folder / name`."""
    (folder / "robot.xml").write_text(text)
    return make_once(folder / "robot.xml", folder / name)


def test_an_mjcf_becomes_a_robot(tmp_path):
    """Oracle: the figures in the file; MuJoCo's mass matrix, rotors in it."""
    made(WITH_BOW, tmp_path)
    robot = load_robot(str(tmp_path / "made" / "robot.yaml"))
    sole, legs = robot.params.sole, robot.params.legs
    assert legs.length == pytest.approx(THIGH + SHIN)
    assert legs.hip_width == pytest.approx(2.0 * HIP)
    assert (sole.x_min, sole.x_max) == pytest.approx((-0.07, 0.17))
    assert (sole.half_width, sole.z) == pytest.approx((0.05, -0.08))
    plant = robot.control_plant()
    context = plant.CreateDefaultContext()
    scene = "(?s)<asset>.*?</asset>|<geom type=.mesh.*?/>|<contact.*?t>"
    without = re.sub(scene, "", WITH_BOW)
    model = mujoco.MjModel.from_xml_string(without)
    data, order = mujoco.MjData(model), {}
    for i, name in enumerate([*JOINTS, "bow"]):
        angle = 0.1 * (i + 1)
        joint = plant.GetJointByName(name)
        joint.set_angle(context, angle)
        data.qpos[model.joint(name).qposadr] = angle
        order[joint.velocity_start()] = int(model.joint(name).dofadr[0])
    mujoco.mj_forward(model, data)
    theirs = np.zeros((model.nv, model.nv))
    for column, unit in zip(theirs, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    ours = plant.CalcMassMatrix(context)
    drake, their = list(order), list(order.values())
    assert ours[np.ix_(drake, drake)] == pytest.approx(
        theirs[np.ix_(their, their)], rel=1e-5, abs=1e-6
    )
    assert set(plant.GetEffortUpperLimits()) == {250.0, 9.0}


def test_heavy_arms_are_not_taken_for_legs(tmp_path):
    """Oracle: the names; the arms are legs but for a third more mass."""
    chest = '<geom type="box" size="0.1 0.15 0.2" pos="0 0 0.2" mass="20"/>'
    assert chest in MJCF
    arms = (leg("a", 0.3) + leg("b", -0.3)).replace('mass="5"', 'mass="8"')
    arms = re.sub('<joint name="[^"]*"', "<joint", arms)
    guessed = made(MJCF.replace(chest, chest + arms), tmp_path).of("guessed")
    assert guessed[0] == "pelvis pelvis, torso chest, feet l_tilt, r_tilt"


def test_strong_arms_are_not_taken_for_legs(tmp_path):
    """Oracle: the names; 50,000 N m stand for limits that nobody knows."""
    arms = leg("a", 0.3) + leg("b", -0.3)
    motors = "".join(
        f'<motor joint="{n}_{name}" ctrllimited="true" ctrlrange="-5e4 5e4"/>'
        for n in "ab"
        for name in LEG
    )
    text = MJCF.replace("<actuator>", f"<actuator>{motors}")
    chest = '<geom type="box" size="0.1 0.15 0.2" pos="0 0 0.2" mass="20"/>'
    guessed = made(text.replace(chest, chest + arms), tmp_path).of("guessed")
    assert guessed[0] == "pelvis pelvis, torso chest, feet l_tilt, r_tilt"


def test_a_robot_that_is_welded_to_the_world_is_let_go(tmp_path):
    """Oracle: the robot that floats in the file."""
    found = []
    held = MJCF.replace("<freejoint/>", "")
    for name, text in ("free", MJCF), ("held", held):
        notes = made(text, tmp_path, name)
        found.append((tmp_path / name / "robot.yaml").read_text())
    assert found[0] == found[1]
    assert "no longer welded to the world: pelvis" in notes.of("changed")


def test_says_what_hangs_elsewhere_in_the_world(tmp_path):
    """Oracle: a motor on a stand, 20 m up; the robot of the file without it."""
    stand = (
        '<body name="stand" pos="0 0 20"><joint name="dummy" range="-1 1"/>'
        '<geom type="sphere" size="0.1"/></body>'
        '<body name="ball" pos="1 0 1"><freejoint/>'
        '<geom type="sphere" size="0.1"/></body></worldbody>'
    )
    motor = '<actuator><motor joint="dummy"/>'
    with_motor = MJCF.replace("</worldbody>", stand)
    with_motor = with_motor.replace("<actuator>", motor)
    written = []
    for name, text in ("alone", MJCF), ("both", with_motor):
        notes = made(text, tmp_path, name)
        written.append((tmp_path / name / "robot.urdf").read_text())
    assert written[0] == written[1]
    left_out = "left out, not joined to the robot: stand, ball"
    assert left_out in notes.of("changed")


@pytest.mark.parametrize(
    "old, new, message",
    [
        (
            "<freejoint/>",
            '<joint name="rail" axis="0 0 1" range="-1 1"/>',
            "floating bases: must be one; these are: none",
        ),
        ('type="box"', 'type="ball"', "MuJoCo cannot compile it: "),
        (
            '"waist" axis="0 0 1" range="-1 1"',
            '"waist" type="ball"',
            "joint waist: ball: must be revolute or",
        ),
        (
            "<actuator>",
            '<equality><connect body1="l_tilt" body2="chest" anchor="0 0 0"/>'
            "</equality><actuator>",
            "equality : must not be there, a closed loop",
        ),
    ],
)
def test_a_faulty_mjcf_is_refused(tmp_path, old, new, message):
    assert old in MJCF
    with pytest.raises(ValueError, match=message):
        made(MJCF.replace(old, new, 1), tmp_path)
