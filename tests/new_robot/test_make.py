"""A biped that nobody has seen goes through; a faulty one is told so."""

import re

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.walking.state import Side
from nadia_balance.new_robot.make import make_robot
from nadia_balance.parameters.scaling import scaled
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.reach import stride
from tests.new_robot.biped import Biped, make_once

# Rows: forward, left, up.
LYING = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
TURNED = Rotation.from_rotvec([0.0, 0.0, 0.35]).as_matrix()
KNEES = ("l_knee", "r_knee")
BIPEDS = {
    "turned frames": Biped(seed=1),
    "knees that bend the other way": Biped(knee_sign=-1.0, seed=2),
    "a base that lies": Biped(base_axes=LYING, seed=3),
    "wide toes": Biped(heel_half_width=0.03, toe_half_width=0.09),
    "knees of 0 to 180 degrees": Biped(
        knee_range=(0.0, 3.1416), foot_ahead=-0.02, seed=4
    ),
    "drawn bent by 60 degrees": Biped(
        knee_range=(-0.05, 2.1), drawn_bend=1.05, knee_sign=-1.0, seed=5
    ),
    "hip pitch axes at 45 degrees": Biped(hip_slant=0.25 * np.pi, seed=6),
    "drawn with legs apart": Biped(drawn_apart=0.25, seed=7),
    "drawn with toes out": Biped(toes_out=0.3, seed=8),
    "a base turned by 20 degrees, a root on the ground": Biped(
        base_axes=TURNED, footprint=True, seed=9
    ),
    "knees of either way, feet whose mass is behind": Biped(
        knee_range=(-1.5, 1.5), foot_ahead=-0.01, seed=10
    ),
}


@pytest.fixture(scope="module", params=BIPEDS.values(), ids=BIPEDS)
def biped(request):
    return request.param


@pytest.fixture(scope="module")
def made(biped, tmp_path_factory):
    """robot.yaml as it is written, and the robot as it is loaded."""
    folder = tmp_path_factory.mktemp("biped")
    make_once(biped.write(folder), folder / "made")
    file = folder / "made" / "robot.yaml"
    return yaml.safe_load(file.read_text()), load_robot(str(file))


def inscribed(biped: Biped) -> tuple[float, float]:
    """Heel and half-width of the largest rectangle in a tapered sole.

    Of x from the toe to d before it, the half-width at d is w - s d; the area
    d (w - s d) is largest at d = w / 2 s, if the sole is so long.
    """
    length = biped.toe - biped.heel
    slope = (biped.toe_half_width - biped.heel_half_width) / length
    depth = min(biped.toe_half_width / (2.0 * slope), length)
    return biped.toe - depth, biped.toe_half_width - slope * depth


def test_finds_what_it_was_made_of(biped, made):
    """Oracle: the figures it was made of; the rectangle in closed form."""
    written, robot = made
    pelvis = "base_footprint" if biped.footprint else "pelvis"
    assert robot.pelvis_body == pelvis
    assert robot.torso_body == "chest"
    assert robot.foot_bodies == {Side.LEFT: "l_foot", Side.RIGHT: "r_foot"}
    heel, half_width = inscribed(biped)
    found = written["sole"] | written["legs"]
    for name, expected in (
        *(("x_max", biped.toe), ("x_min", heel), ("half_width", half_width)),
        *(("z", -biped.ankle), ("length", biped.thigh + biped.shin)),
        *(("ankle_height", biped.ankle), ("hip_width", 2.0 * biped.hip)),
    ):
        assert found[name] == pytest.approx(expected, abs=2e-4), name
    # Ten of the pelvis, twenty of the chest, arms and both legs.
    assert robot.mass == pytest.approx(10 + 20 + 2 * 3.3 + 2 * 13.8 + 0.02)


def test_stands_with_bent_knees_and_keeps_them_bent(biped, made):
    """Oracle: the law of cosines, the CoM of what the robot is made of."""
    written, robot = made
    for knee in KNEES:
        assert robot.posture[knee] == pytest.approx(
            biped.knee_sign * (0.6 - biped.drawn_bend), abs=1e-4
        )
    plant = robot.control_plant()
    context = plant.CreateDefaultContext()
    for joint, angle in robot.posture.items():
        plant.GetJointByName(joint).set_angle(context, angle)
    com = plant.CalcCenterOfMassPositionInWorld(context)
    legs, height = written["legs"], written["com_height"]
    squared = biped.thigh**2 + biped.shin**2
    squared += 2.0 * biped.thigh * biped.shin * np.cos(0.6)
    sole = plant.GetBodyByName("l_foot").EvalPoseInWorld(context)
    assert sole.rotation().matrix() == pytest.approx(np.eye(3), abs=2e-3)
    p_WS = sole @ robot.X_FootSole[Side.LEFT].translation()
    assert com[2] - p_WS[2] == pytest.approx(height, abs=2e-4)
    # The leg leans a little, to put the sole under the CoM.
    drop = height - legs["com_above_hip"] - legs["ankle_height"]
    lean = p_WS[0] - 0.5 * (robot.params.sole.x_min + robot.params.sole.x_max)
    assert np.hypot(drop, lean) == pytest.approx(np.sqrt(squared), abs=5e-4)
    assert legs["hip_ahead"] == pytest.approx(p_WS[0] - com[0] - lean, abs=2e-4)
    limits = written["whole_body"]
    least = biped.knee_sign * (0.1 - biped.drawn_bend)
    bent = pytest.approx(dict.fromkeys(KNEES, least), abs=1e-4)
    found = [limits[f"joint_{way}_limits"] for way in ("lower", "upper")]
    assert found[:: int(biped.knee_sign)] == [bent, {}]


def faulty(folder, *faults, make=make_once, **options):
    """Makes the robot of a URDF in which regular expressions are replaced."""
    file = Biped(turned=False).write(folder)
    text = file.read_text()
    for pattern, replacement in faults:
        text, count = re.subn(pattern, replacement, text, flags=re.DOTALL)
        assert count, pattern
    file.write_text(text)
    return make(file, folder / "made", **options)


def times(attribute, factor, within=""):
    """Multiplies the numbers in an attribute."""

    def larger(match):
        numbers = map(float, match[2].split())
        return match[1] + " ".join(str(factor * n) for n in numbers)

    return rf'({within}(?:{attribute})=")([^"]*)', larger


def rod(parent, child):
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return "</robot>", f'<joint name="rod" type="fixed">{ends}</joint></robot>'


BACKWARD = '"0.0" upper="2.3"', '"-2.3" upper="0.0"'
NO_EFFORT = r' effort="250"', ""
RIGHT_FOOT = r'<geometry>(\s*<mesh filename="[^"]*/r_foot)'
HIGHER = RIGHT_FOOT, r'<origin xyz="0 0 0.02"/><geometry>\1'
PITCH = '<axis xyz="0 1 0"/><limit effort="9" lower="-1" upper="1"/>'
TOES = r'(_sole_frame" type=")fixed">', rf'\1revolute">{PITCH}'
BALLS = r'<mesh filename="[^"]*/l_foot.stl"', '<sphere radius="0.05"'


@pytest.mark.parametrize(
    "name, old, new, message",
    [
        ("l_yaw", "revolute", "fixed", "legs: must be two, of 6"),
        ("l_tilt", "revolute", "continuous", "joint l_tilt: continuous: must"),
        ("bow", "revolute", "planar", "joint bow: planar: must be revol"),
        ("r_knee", "</joint>", "<mimic/></joint>", "joint r_knee: mimic: must"),
        ("r_hip", *NO_EFFORT, "joint r_hip: no effort limit: m"),
        ("l_roll", 'lower="-0.6"', 'lower="0.7"', "joint l_roll: lower limit"),
        (
            "l_knee",
            *BACKWARD,
            "joint l_knee: must bend the knee, so that the f",
        ),
        ("l_ankle", '"-1.0"', '"0.3"', "joints l_hip, l_ankle, r"),
        ("l_shin", 'value="4', 'value="-4', "link l_shin: mass: value = '-4"),
        ("", *HIGHER, "soles of l_foot and r_foot: must"),
        ("", *BALLS, "foot l_foot: must have a shape with"),
        ("", "foot.stl", 'foot.stl" scale="9 9 9', "sole of l_foot: 2.16 m l"),
        ("", *TOES, "_sole_frame: must be welded, --fix "),
        ("", *times("xyz", 1000), "with legs of 780 m: must be in (9.49e"),
        ("l_knee", 'upper="2.3"', 'upper="132"', "joint l_knee: range of 0 to"),
        ("chest", '0 0.250*"', '0 25.0"', "link chest: centre of mass: must"),
        ("", "package://", "package://no_", "there is no package://no_biped"),
        ("l_ankle", "-0.380*", "-0.35", "they are 0.750 and 0.780"),
        ("", *rod("chest", "l_foot"), "link l_foot: must be held by on"),
        ("", *rod("chest", "pelvis"), "none; links in closed loops: pelvis"),
        ("", '<joint name="waist".*?</joint>', "", "floating bases: must be"),
        ("", "l_thigh", "l::thigh", "link 'l::thigh': must be a uniq"),
        ("waist", 'rpy="', 'rpy="180 ', "joint waist: origin: rpy = "),
    ],
)
def test_a_faulty_biped_is_refused_in_a_line(tmp_path, name, old, new, message):
    """Oracle: what was made wrong, and where."""
    if name:
        old, new = rf'(name="{name}"(?!/).*?){old}', rf"\g<1>{new}"
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        faulty(tmp_path, (old, new))
    assert "\n" not in str(error.value)


ASIDE = RIGHT_FOOT, r'<origin xyz="0 0 0" rpy="0 0 1.5708"/><geometry>\1'
SHIN = 'name="l_shin">.*?'
DEGREES = r'(name="l_swing".*?lower=")-1.5', r"\1-120"
SWAP = [('"l_', '"L_'), ('"r_', '"l_'), ('"L_', '"r_')]


def test_a_torso_is_of_no_leg(tmp_path):
    with pytest.raises(ValueError, match="^torso = 'l_shin': must not be of"):
        faulty(tmp_path, named={"torso": "l_shin"})


def test_sides_are_told_by_names_if_by_nothing_else(tmp_path):
    """Oracle: the feet's names; without sides in them it is refused."""
    biped = Biped(knee_range=(-1.5, 1.5), heel=-0.12, toe=0.12)
    file = biped.write(tmp_path)
    make_once(file, tmp_path / "made")
    robot = load_robot(str(tmp_path / "made" / "robot.yaml"))
    assert robot.foot_bodies == {Side.LEFT: "l_foot", Side.RIGHT: "r_foot"}
    text = file.read_text().replace('"l_', '"a_').replace('"r_', '"b_')
    file.write_text(text)
    with pytest.raises(ValueError, match="^feet a_foot and b_foot: knees, so"):
        make_robot(file, tmp_path / "again")


@pytest.mark.parametrize(
    "faults, message",
    [
        ([times("value", 10, SHIN)], "left and right differ: link masses at"),
        ([times("ixx|iyy|izz", 100)], "moments of inertia too large "),
        ([times("effort", 10)], "effort limits > 548 N m, weight times leg: "),
        ([ASIDE], "the sole of r_foot is wider than long, 0.240 and 0.120 m"),
        (SWAP, "left and right swapped? On the other side, seen forward: "),
        ([('"l_foot"', '"left_foot_cleat_front_right"')], ""),
        ([('"l_foot"', '"right_foot"')], "left and right swapped? On the othe"),
        ([DEGREES], "range beyond +-2 pi: degrees?: l_swing"),
    ],
)
def test_doubts_on_one_line_what_is_hardly_meant(tmp_path, faults, message):
    """Oracle: what was made wrong, by hand."""
    warnings = faulty(tmp_path, *faults).of("warning")
    assert [line[: len(message)] for line in warnings] == [message] * bool(
        message
    )


def test_rotor_inertias_may_be_of_another_file(tmp_path):
    """Oracle: what is written there; of other joints, the guess."""
    other = tmp_path / "other"
    other.mkdir()
    file, beside = Biped().write(tmp_path), Biped().write(other)
    for path, joint, value in (beside, "l_knee", 0.03), (file, "waist", 0.2):
        drive = (
            '<transmission name="d"><type>transmission_interface/'
            f'SimpleTransmission</type><joint name="{joint}"/>'
            f'<actuator name="m"><d:rotor_inertia value="{value}" '
            'xmlns:d="http://drake.mit.edu"/></actuator></transmission></robot>'
        )
        path.write_text(path.read_text().replace("</robot>", drive))
    made = make_once(file, tmp_path / "made", armature=beside)
    assert "rotor inertia of 14 joints" in made.of("unknown")[0]
    text = (tmp_path / "made" / "robot.urdf").read_text()
    for value in 0.03, 0.2:
        assert text.count(f'rotor_inertia value="{value}"') == 1


def test_says_what_it_mends(tmp_path):
    """Oracle: what is wrong with the biped, by hand; paths are of this run."""
    mesh = '<mesh filename="package://hands/thumb.stl"'
    (tmp_path / "broken.stl").write_bytes(80 * b" " + b"\7\0\0\0")
    broken = '<mesh filename="broken.stl"'
    red = '<material name="red"><color rgba="255 0 0 1"/></material>'
    notes = faulty(
        tmp_path,
        (r'(name="l_shin".*?ixx=")', r"\g<1>-"),
        (r'(name="waist" type=")revolute', r"\1continuous"),
        (r'(name="bow".*?) effort="250"', r"\1"),
        (r'(name="l_thumb".*?)<sphere radius="0.01"', rf"\1{mesh}"),
        (r'(name="r_thumb".*?)<sphere radius="0.01"', rf"\1{broken}"),
        (r'(name="l_palm".*?)radius="0.02"', r'\1radius="0.00"'),
        (r'(name="r_palm".*?<visual>)', rf"\1{red}"),
        (r'(name="chest".*?i..=").*?(".*?").*?(".*?").*?"', r'\1 0\2 0\3 0"'),
        fix=["r_sw.*"],
        make=make_robot,
    )
    assert notes.of("changed") == [
        "left out the tags: gazebo",
        "left out visual of link l_thumb: there is no "
        "package://hands/thumb.stl (--package-root?)",
        "left out visual of link l_palm: sphere: radius = '0.00': must be > 0",
        f"left out visual of link r_thumb: {tmp_path}/broken.stl: must be a "
        "whole STL, OBJ or Collada file",
        "left out the colours of: visual of link r_palm",
        "moments of inertia of 0, now of a box: chest",
        "moments of inertia that no body has, made possible: l_shin",
        "welded as asked: r_swing",
        "welded, mimic: l_grip, r_grip",
        "welded, prismatic: l_slide, r_slide",
        "turn by +-pi, not for ever: waist",
        "welded, no effort limit: bow",
    ]
    robot = load_robot(str(tmp_path / "made" / "robot.yaml"))
    joints = robot.control_plant().num_velocities() - 6
    assert joints == 2 * 6 + len(["waist", "l_swing"])


def test_rods_beside_a_leg_are_parts_of_it(tmp_path):
    """Oracle: the shin's mass with and without."""
    masses = []
    for rods in (False, True):
        folder = tmp_path / str(rods)
        folder.mkdir()
        file = Biped(turned=False, rods=rods).write(folder)
        notes = make_once(file, folder / "made")
        assert ("l_rod, r_rod" in str(notes.of("changed"))) is rods
        plant = load_robot(str(folder / "made" / "robot.yaml")).control_plant()
        masses.append(plant.GetBodyByName("l_shin").default_mass())
    assert masses[1] - masses[0] == pytest.approx(0.2)


def test_names_of_the_user_come_first(tmp_path):
    """Oracle: the names; what is found has others."""
    named = {"torso": "spine", "left_foot": "l_sole"}
    file = Biped(turned=False).write(tmp_path)
    notes = make_once(file, tmp_path / "made", named=named)
    guessed = notes.of("guessed")
    assert guessed[0] == "pelvis pelvis, torso spine, feet l_foot, r_foot"


def test_meshes_may_be_in_a_package_elsewhere(tmp_path):
    """Oracle: the sole, which is of a mesh."""
    file, roots = Biped(turned=False).write(tmp_path), tmp_path / "roots"
    roots.mkdir()
    package = "biped_description"
    (tmp_path / package).rename(roots / package)
    made = make_once(file, tmp_path / "made", package_roots=[roots])
    guessed = made.of("guessed")
    assert guessed[3].startswith("sole 0.240 x 0.100 m, of 0.240 x 0.120 m")


def test_stiff_ankles_keep_it_from_nadias_width(tmp_path):
    """Oracle: whole-body inverse kinematics, beyond the reach and within.

    They roll by 11 degrees only.
    """
    make_once(Biped(ankle_roll=0.2).write(tmp_path), tmp_path / "made")
    stiff = load_robot(str(tmp_path / "made" / "robot.yaml"))
    own = stiff.point_mass.reach
    nadias = scaled(ReachabilityParams(), stiff.params.size)
    assert own.length_forward < nadias.length_forward * 1.001
    assert stride(stiff, np.array([0.0, own.width_max])) is not None
    assert stride(stiff, np.array([0.0, nadias.width_max])) is None
