"""RobotModel: its figures agree with the URDF, its errors can be read."""

import contextlib
import re
import shutil

import numpy as np
import pytest

from nadia_balance.robot import model
from nadia_balance.robot.model import MODELS, load_robot, robot_names
from nadia_balance.robot.plants import actuators

ROBOT = load_robot("nadia")


def standing(robot, width=None):
    """Its plant, and the context in which it stands with this step width."""
    plant = robot.control_plant()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, robot.standing_positions(width))
    return plant, context


@pytest.mark.parametrize("width", [None, 0.125, 0.5])
def test_stands_with_level_soles_and_the_com_over_their_middle(width):
    """Oracle: forward kinematics.  SNOPT is content with some 1e-7."""
    plant, context = standing(ROBOT, width)
    for side, X_FS in ROBOT.X_FootSole.items():
        foot = plant.GetBodyByName(ROBOT.foot_bodies[side])
        X_WF = foot.EvalPoseInWorld(context) @ X_FS
        y = 0.5 * side.sign * (width or 0.25)
        assert X_WF.translation() == pytest.approx([0.0, y, 0.0], abs=1e-6)
        assert X_WF.rotation().IsNearlyIdentity(1e-5)
    com = plant.CalcCenterOfMassPositionInWorld(context)
    assert com == pytest.approx([0.0, 0.0, ROBOT.com_height], abs=1e-6)
    pelvis = plant.GetBodyByName(ROBOT.pelvis_body).EvalPoseInWorld(context)
    assert pelvis.rotation().IsNearlyIdentity(1e-9)


def load(folder):
    return load_robot(str(folder / "robot.yaml"))


@pytest.mark.parametrize("width", [2.0, np.nan])
def test_refuses_a_step_width_out_of_reach(width):
    """Oracle: two legs of 0.88 m and 0.26 m between them, all in a line."""
    with pytest.raises(ValueError, match=f"{width}.*: must be (within|> 0)"):
        ROBOT.standing_positions(width)


def test_refuses_an_unknown_name_and_lists_the_known(tmp_path):
    """Oracle: the folders in models."""
    assert robot_names() == ["atlas", "g1", "nadia"]
    with pytest.raises(ValueError, match="robot = 'adam': .*atlas, g1, nadia"):
        load_robot("adam")
    with pytest.raises(FileNotFoundError, match="robot.yaml: no such file"):
        load_robot(str(tmp_path / "robot.yaml"))


@pytest.fixture
def copy(tmp_path):
    """A robot of one's own: a copy of Nadia's folder."""
    return shutil.copytree(MODELS / "nadia", tmp_path / "own")


def change(path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_a_robot_of_the_package_that_has_changed_is_read(copy, monkeypatch):
    """Oracle: its files; who changes what was read changes nothing else."""
    monkeypatch.setattr(model, "MODELS", copy.parent)
    for old, new in (377, 370), (370, 360):
        params, _ = model.load_robot_params("own")
        assert params.drives.motors["ankle_y"].max_torque == old
        params.drives.motors.clear()
        assert model.load_robot_params("own")[0].drives.motors
        change(copy / "robot.yaml", f"max_torque: {old}", f"max_torque: {new}")


@pytest.mark.parametrize("strength", [0.99, 1.01])
def test_refuses_ankles_too_weak_to_stand(copy, strength):
    """Oracle: half the weight under the sole's centre, by its lever.

    Less the weight of what is below the ankle.
    """
    plant, context = standing(ROBOT)
    ankle_link = plant.GetBodyByName("LEFT_ANKLE_LINK")
    ankle = ankle_link.EvalPoseInWorld(context).translation()[0]
    needed = 0.5 * ROBOT.mass * 9.81 * (0.0 - ankle)
    for link in ankle_link, plant.GetBodyByName("LEFT_FOOT_LINK"):
        p_LC = link.CalcCenterOfMassInBodyFrame(context)
        com = link.EvalPoseInWorld(context) @ p_LC
        needed -= link.get_mass(context) * 9.81 * (com[0] - ankle)
    weak = f"max_torque: {strength * needed}"
    change(copy / "robot.yaml", "max_torque: 377", weak)
    may_raise = contextlib.nullcontext()
    if strength < 1.0:
        message = "LEFT_ANKLE_Y = 2.*for the robot to"
        may_raise = pytest.raises(ValueError, match=message)
    with may_raise:
        load(copy)


def test_max_joint_speed_is_of_joints_without_a_limit(copy):
    """Oracle: the first joint of the URDF, the spine's; all others have 12."""
    change(copy / "nadia.urdf", ' velocity="12"', "")
    change(copy / "robot.yaml", "name: nadia", "name: own\nmax_joint_speed: 7")
    speeds = load(copy).max_joint_speeds
    assert sorted(speeds) == [7.0] + 22 * [12.0]


def test_transmissions_may_be_missing(copy):
    """Oracle: Nadia's own effort limits, in the order of the velocities."""
    urdf = copy / "nadia.urdf"
    drives = re.compile("<transmission.*?</transmission>", re.DOTALL)
    urdf.write_text(drives.sub("", urdf.read_text()))
    bare = load(copy)
    assert effort_limits(bare) == effort_limits(ROBOT)
    (remark,) = bare.remarks
    assert remark.startswith("no rotor inertia: SPINE_Z, SPINE_X")
    assert not ROBOT.remarks


def effort_limits(robot):
    """Effort limits [N m] of the robot's plant, by joint."""
    plant = robot.control_plant()
    return {
        drive.joint().name(): drive.effort_limit() for drive in actuators(plant)
    }


def test_torque_limits_are_those_of_the_robot_yaml(copy):
    """Oracle: robot.yaml; all other limits are as before.  Ideal has none."""
    change(copy / "robot.yaml", "max_torque: 270", "max_torque: 251.5")
    limits = effort_limits(load(copy))
    both = {"LEFT_HIP_X": 251.5, "RIGHT_HIP_X": 251.5}
    assert limits == effort_limits(ROBOT) | both
    ideal = effort_limits(load_robot("nadia", "ideal"))
    assert {limit for name, limit in ideal.items() if "HIP" in name} == {1e3}


def test_shapes_are_missed(copy):
    """Oracle: the collision shapes, taken away from all links but the feet."""
    urdf = copy / "nadia.urdf"
    shapes = "<collision.*?</collision>"
    parts = re.split("(<link .*?</link>)", urdf.read_text(), flags=re.DOTALL)
    bare = [re.sub(shapes, "", part, flags=re.DOTALL) for part in parts]
    with_feet = [
        part if "FOOT_LINK" in part[:40] else other
        for part, other in zip(parts, bare, strict=True)
    ]
    urdf.write_text("".join(with_feet))
    (remark,) = load(copy).remarks
    assert remark.startswith("only the feet have collision shapes")
    urdf.write_text("".join(bare))
    with pytest.raises(ValueError, match="foot LEFT_FOOT_LINK: must"):
        load(copy)


def test_an_ideal_robot_has_no_limits_of_joint_speed():
    """Oracle: by hand."""
    assert np.isinf(load_robot("nadia", "ideal").max_joint_speeds).all()


def of_yaml(old, new, named):
    return "robot.yaml", old, new, named


def of_urdf(old, new, named):
    return "nadia.urdf", old, new, f"urdf = .*{named}"


@pytest.mark.parametrize(
    ("file", "old", "new", "named"),
    [
        of_yaml("urdf: nadia.urdf", "urdf: none.urdf", "urdf"),
        of_yaml("name: nadia", "name: a\ncom_height: 2.0", "com_height = 2.0"),
        of_yaml("name: nadia", "name: a\nsole: {x_max: -0.1}", "sole.x_max"),
        of_yaml("TORSO_LINK", "TRUNK", "torso_body"),
        of_yaml("step_width: 0.25 ", "", "step_width: must be given"),
        of_yaml("torso_body: TORSO_LINK", "", "torso_body: must be given"),
        of_yaml("pelvis_body: PELVIS", "pelvis_body: TORSO", "pelvis_body"),
        of_yaml("foot_body: RIGHT", "foot_body: LEFT", "left_foot_body"),
        of_yaml("{LEFT_KNEE_Y: 0.1", "{KNEE: 0.1", "joint_lower_limits.KNEE"),
        of_yaml("[LEFT_HIP_X", "[HIP", "motors.hip_x.joints = HIP: must"),
        of_yaml("[LEFT_HIP_X", "[LEFT_HIP_Y", "hip_y.joints = LEFT_HIP_Y: m"),
        of_yaml("KNEE_Y: 0.552", "KNEE_Y: -0.5", "posture.LEFT_KNEE_Y"),
        of_urdf("</robot>", "", "no element found"),
        of_urdf("</robot>", "<link/></robot>", "name"),
        of_urdf('value="19.0917"', 'value="0"', "mass of PELVIS_LINK"),
        of_urdf('ixx="0.0942"', 'ixx="-0.0942"', "inertia"),
        of_urdf('"0 0.115 -0.07185"', '"0 nan 0"', "xyz"),
        of_urdf('lower="-0.7854"', 'lower="1"', "lower limit of LEFT_HIP_Z"),
        of_urdf('velocity="12"', 'velocity="-1"', "velocity limit of SPINE_Z"),
        of_urdf(' velocity="12"', "", "SPINE_Z"),
        of_urdf('inertia value="0', 'inertia value="-0', "LEFT_HIP_Z"),
        of_urdf('"LEFT_KNEE_Y"/>', '"LEFT_HIP_Y"/>', "two <transmission>s"),
        of_urdf(' effort="350"', "", "LEFT_KNEE_Y"),
        of_urdf('effort="350"', 'effort="20"', "effort limit of LEFT_KNEE_Y"),
        of_urdf('Z" type="revolute"', 'Z" type="prismatic"', "SPINE_Z"),
        of_urdf(
            '<joint name="SPINE_X" type="revolute">',
            '<joint name="SPINE_X" type="revolute"><mimic joint="SPINE_Z"/>',
            "SPINE_X",
        ),
        # Only a plant with shapes, such as the simulated one, reads these.
        of_urdf('radius="0.005"/>', 'radius="-1"/>', "radius = -1"),
        of_urdf(
            '<drake:ellipsoid a="0.11" b="0.13" c="0.075"/>',
            '<mesh filename="robot.yaml"/>',
            "mesh of PELVIS_LINK",
        ),
        of_urdf('child link="TORSO_LINK"', 'child link="PELVIS_LINK"', "loops"),
    ],
)
def test_a_bad_file_is_refused_on_one_line(copy, file, old, new, named):
    change(copy / file, old, new)
    with pytest.raises((ValueError, FileNotFoundError), match=named) as error:
        load(copy)
    assert "\n" not in str(error.value)
