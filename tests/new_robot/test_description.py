"""However a robot's description is seen, it stays the robot of the file."""

from xml.etree import ElementTree

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from nadia_balance.new_robot.make import make_robot
from nadia_balance.robot.model import load_robot
from tests.new_robot.biped import Biped

NAMES = ("waist", "bow", "l_hip", "l_knee", "l_tilt", "r_roll", "r_ankle")
ANGLES = dict(zip(NAMES, (0.3, -0.2, -0.5, 0.8, 0.2, 0.1, -0.4), strict=True))


def seen_by_drake(file, folder):
    """The inertia about a thigh, and the mass matrix of the legs.

    Without shapes, as Drake reads no STL, and without rotors.
    """
    tree = ElementTree.parse(file)
    for drive in tree.findall("transmission"):
        tree.getroot().remove(drive)
    for link in tree.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    for joint in tree.findall("joint"):
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
    bare = folder / "bare.urdf"
    tree.write(bare)
    plant = MultibodyPlant(0.001)
    Parser(plant).AddModels(str(bare))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    for name, angle in ANGLES.items():
        plant.GetJointByName(name).set_angle(context, angle)
    thigh = plant.GetFrameByName("r_thigh")
    bodies = plant.GetBodyIndices(
        plant.GetBodyByName("pelvis").model_instance()
    )
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
    make_robot(file, tmp_path / "made")
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


MOTORS = "".join(
    f'<motor joint="{joint}" ctrllimited="true" ctrlrange="-250 250"/>'
    for joint in ["waist", *(f"{n}_{name}" for n in "lr" for name in LEG)]
)
MJCF = f"""
<mujoco model="mj">
<compiler angle="radian" autolimits="true"/>
<worldbody>
<body name="pelvis" pos="0 0 1"><freejoint/>
 <geom type="box" size="0.08 0.1 0.08" mass="10"/>
 {leg("l", HIP)}{leg("r", -HIP)}
 <body name="chest" pos="0 0 0.15">
  <joint name="waist" axis="0 0 1" range="-1 1"/>
  <geom type="box" size="0.1 0.15 0.2" pos="0 0 0.2" mass="20"/>
 </body>
</body>
</worldbody>
<actuator>{MOTORS}</actuator>
</mujoco>"""


def test_an_mjcf_becomes_a_robot(tmp_path):
    """Oracle: the figures in the file."""
    file = tmp_path / "robot.xml"
    file.write_text(MJCF)
    make_robot(file, tmp_path / "made")
    params = load_robot(str(tmp_path / "made" / "robot.yaml")).params
    sole, legs = params.sole, params.legs
    assert legs.length == pytest.approx(THIGH + SHIN)
    assert legs.hip_width == pytest.approx(2.0 * HIP)
    assert (sole.x_min, sole.x_max) == pytest.approx((-0.07, 0.17))
    assert (sole.half_width, sole.z) == pytest.approx((0.05, -0.08))


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("<freejoint/>", "", "floating bases: must be one; these are: none"),
        ("</worldbody>", "", "malformed XML: "),
        ('type="box"', 'type="ball"', "Drake cannot read it: "),
        (
            '<joint name="waist"',
            '<joint name="bow" axis="0 1 0"/><joint name="waist"',
            "body chest: must have one joint",
        ),
        (
            "<actuator>",
            '<equality><connect body1="l_tilt" body2="chest" anchor="0 0 0"/>'
            "</equality><actuator>",
            "constraints: must not be there",
        ),
    ],
)
def test_a_faulty_mjcf_is_refused(tmp_path, old, new, message):
    assert old in MJCF
    file = tmp_path / "robot.xml"
    file.write_text(MJCF.replace(old, new, 1))
    with pytest.raises(ValueError, match=message):
        make_robot(file, tmp_path / "made")
