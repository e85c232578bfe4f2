"""Nadia, scaled: the same shape and density, in gravity as it is."""

from dataclasses import asdict
from pathlib import Path
from xml.etree import ElementTree

import yaml

from nadia_balance.robot.model import MODELS, load_robot_params

_DRAKE = "http://drake.mit.edu"
ElementTree.register_namespace("drake", _DRAKE)  # Drake knows this prefix
# Powers of the length, by tag and attribute of the URDF.
_POWERS = {
    ("origin", "xyz"): 1,
    ("mass", "value"): 3,
    **{("inertia", f"i{ab}"): 5 for ab in "xx yy zz xy xz yz".split()},
    ("box", "size"): 1,
    **{
        (f"{prefix}{shape}", field): 1
        for prefix in ("", f"{{{_DRAKE}}}")
        for shape in ("sphere", "cylinder", "capsule", "ellipsoid")
        for field in ("radius", "length", "a", "b", "c")
    },
    ("limit", "effort"): 4,
    ("limit", "velocity"): -0.5,
    (f"{{{_DRAKE}}}rotor_inertia", "value"): 5,
}
# Fields of robot.yaml that are lengths, or have them.
_LENGTHS = ("sole", "legs", "com_height", "step_width")


def scaled_nadia(ratio: float, folder: Path) -> Path:
    """Writes Nadia, `ratio` times as large, and returns its robot.yaml."""
    source = MODELS / "nadia"
    tree = ElementTree.parse(source / "nadia.urdf")
    for element in tree.iter():
        for field, text in element.attrib.items():
            if power := _POWERS.get((element.tag, field)):
                numbers = (float(word) * ratio**power for word in text.split())
                element.set(field, " ".join(map(repr, numbers)))
    tree.write(folder / "nadia.urdf")
    robot = yaml.safe_load((source / "robot.yaml").read_text("utf-8"))
    del robot["reachability"]
    known = asdict(load_robot_params("nadia")[0])
    robot |= {name: _times(known[name], ratio) for name in _LENGTHS}
    for motor in robot["drives"]["motors"].values():
        motor["max_torque"] *= ratio**4
    file = folder / "robot.yaml"
    file.write_text(yaml.safe_dump(robot), encoding="utf-8")
    return file


def _times(value: float | dict, ratio: float) -> float | dict:
    if isinstance(value, dict):
        return {name: _times(part, ratio) for name, part in value.items()}
    return value * ratio
