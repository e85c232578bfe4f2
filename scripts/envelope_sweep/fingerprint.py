"""Hashes of what a trial depends on: the code, the scenario, the robot."""

import ast
import copy
import functools
import hashlib
from collections.abc import Iterable
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

import nadia_balance
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.summary import versions
from nadia_balance.robot.model import load_robot

# Folders and modules on which a row depends; not reports and plots.
FOLDERS = (
    "",
    "analysis",
    "core/**",
    "diagrams",
    "engines",
    "models/*",
    "results",
    "robot",
    "systems",
    "view",
)
TRIAL_FILES = ("fingerprint.py", "search.py", "sweep.py", "trial.py")


@functools.cache  # the files may change later
def this_code() -> dict[str, str]:
    """Returns the versions and the hash of the code of this process."""
    return {**versions(), "code": code_hash()}


def code_hash(package: Path = Path(nadia_balance.__file__).parent) -> str:
    """Returns a hash (16 hex digits) of the code that trials use.

    Comments and docstrings do not count; the hash depends on Python's version.
    `package` is the folder of nadia_balance.
    """
    parts = []
    for path in code_files(package):
        parts.append(path.relative_to(package).as_posix().encode())
        is_code = path.suffix == ".py"
        parts.append(without_words(path.read_bytes(), is_code))
    return _digest(parts)


def code_files(package: Path) -> list[Path]:
    """Returns the files in `package` that trials use, in order."""
    paths = {
        path
        for folder in FOLDERS
        for ending in ("py", "yaml", "urdf")
        for path in package.glob(f"{folder}/*.{ending}".lstrip("/"))
    }
    paths |= {package / "scripts/envelope_sweep" / name for name in TRIAL_FILES}
    return sorted(paths)


@functools.cache
def without_words(text: bytes, is_code: bool) -> bytes:
    """Returns a file's bytes; Python code without docstrings and comments."""
    if not is_code:
        return text
    tree = ast.parse(text)
    kinds = ast.Module, ast.ClassDef, ast.FunctionDef
    for node in ast.walk(tree):
        if isinstance(node, kinds) and ast.get_docstring(node) is not None:
            del node.body[0]
    return ast.dump(tree).encode()


def parameters_hash(*scenarios: Scenario) -> str:
    """Returns a hash (16 hex digits) of the parameters of all trials.

    It covers the `scenarios` without their robot, the seed, the mechanisms, and
    size, direction and time of the push, which a sweep varies.
    """
    texts = []
    for common in map(copy.deepcopy, scenarios):
        common.description, common.robot, common.seed = "", "", 0
        common.mechanisms = ""
        for push in common.pushes:
            push.delta_v, push.force = 0.0, None
            push.direction_deg, push.at = 0, ""
        texts.append(yaml_dump_typed(common).encode())
    return _digest(texts)


def robot_hash(name: str) -> str:
    """Returns a hash (16 hex digits) of a robot's files, not of their paths.

    Raises:
        ValueError: the robot is unknown or invalid.
        FileNotFoundError: a file of the robot is missing.
    """
    robot = load_robot(name)
    urdf = robot.urdf.read_text(encoding="utf-8")
    return _digest([yaml_dump_typed(robot.params).encode(), urdf.encode()])


def _digest(parts: Iterable[bytes]) -> str:
    whole = hashlib.sha256()
    for part in parts:
        whole.update(hashlib.sha256(part).digest())
    return whole.hexdigest()[:16]
