"""What Drake has read is the robot of the file."""

import numpy as np
import pytest

from nadia_balance.new_robot.make import make_robot
from nadia_balance.new_robot.notes import Notes
from nadia_balance.new_robot.read_drake import read_with_drake
from nadia_balance.new_robot.read_urdf import read_urdf
from nadia_balance.robot import load_robot
from tests.new_robot.biped import Biped

THIGH, SHIN, HIP, SOLE = 0.4, 0.38, 0.12, (0.24, 0.1)


def test_a_urdf_is_what_our_own_reader_finds(tmp_path):
    """Oracle: read_urdf; the poses of all links, bent, masses and limits."""
    make_robot(Biped(seed=8).write(tmp_path), tmp_path / "made")
    file = tmp_path / "made" / "robot.urdf"
    ours = read_urdf(file, [], Notes())
    theirs = read_with_drake(file, [], Notes())
    angles = dict(zip(ours.joints, np.linspace(0.1, 0.6, 20), strict=False))
    poses, others = ours.poses(angles), theirs.poses(angles)
    assert ours.root == theirs.root
    for name, link in ours.links.items():
        assert poses[name].IsNearlyEqualTo(others[name], 1e-9)
        other = theirs.links[name]
        assert link.inertia.CopyToFullMatrix6() == pytest.approx(
            other.inertia.CopyToFullMatrix6(), abs=1e-9
        )
        assert len(link.collisions) == len(other.collisions)
        assert len(link.visuals) == len(other.visuals)
    for name, joint in ours.joints.items():
        for what in ("lower", "upper", "effort", "speed", "rotor_inertia"):
            found = getattr(theirs.joints[name], what)
            assert found == pytest.approx(getattr(joint, what))


SMALL = '<geom type="sphere" size="0.03" mass="0.5"/>'
THICK = '<geom type="capsule" size="0.05" fromto="0 0 -0.1 0 0 -0.3" mass="5"/>'
PLATE = (
    f'<geom type="box" size="{0.5 * SOLE[0]} {0.5 * SOLE[1]} 0.02" '
    'pos="0.05 0 -0.06" mass="1"/>'
)


def leg(n: str, side: float) -> str:
    """Six bodies, one in the other."""
    bodies = (
        ("yaw", f"0 {side * HIP} -0.1", "0 0 1", "-1 1", SMALL),
        ("roll", "0 0 0", "1 0 0", "-1 1", SMALL),
        ("hip", "0 0 0", "0 1 0", "-2 1", THICK),
        ("knee", f"0 0 {-THIGH}", "0 1 0", "0 2.2", THICK),
        ("ankle", f"0 0 {-SHIN}", "0 1 0", "-1 0.6", SMALL),
        ("tilt", "0 0 0", "1 0 0", "-0.4 0.4", PLATE),
    )
    return (
        "".join(
            f'<body name="{n}_{name}" pos="{at}">'
            f'<joint name="{n}_{name}" axis="{axis}" range="{limits}"/>{shape}'
            for name, at, axis, limits, shape in bodies
        )
        + 6 * "</body>"
    )


MOTORS = "".join(
    f'<motor joint="{joint}" ctrllimited="true" ctrlrange="-250 250"/>'
    for joint in [
        "waist",
        *(
            f"{n}_{name}"
            for n in "lr"
            for name in ("yaw", "roll", "hip", "knee", "ankle", "tilt")
        ),
    ]
)
MJCF = f"""
<mujoco model="mj">
<compiler angle="radian" autolimits="true"/>
<worldbody>
<body name="pelvis" pos="0 0 1"><freejoint/>
 <geom type="box" size="0.08 0.1 0.08" mass="10"/>
 {leg("l", 1.0)}{leg("r", -1.0)}
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
        ("<freejoint/>", "", "floating bases: must be one; these are: $"),
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
