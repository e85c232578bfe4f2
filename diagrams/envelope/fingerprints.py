"""Hashes of what the result of a trial depends on."""

import copy
import hashlib
from collections.abc import Iterable
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

from diagrams.mechanisms import AS_IN_PARAMETERS
from diagrams.scenario import Scenario
from diagrams.summary import versions
from nadia_balance.core.push import Push
from nadia_balance.robot import MODELS, RobotModel, load_robot

# Of this package, what a row depends on; reports and plots are free to change.
TRIAL_FILES = (
    *("capturability.py", "limit_search.py", "moment.py", "sweep_plan.py"),
    "trial.py",
)


def parameters_hash(scenario: Scenario) -> str:
    """Returns 16 hex digits for all that is the same in every trial.

    That is `scenario` and its robot, without the seed, the mechanisms, and
    how hard, which way and when the push is: a sweep sets these itself.

    Raises:
        ValueError: the robot is unknown or makes no sense.
        FileNotFoundError: a file of the robot is missing.
    """
    robot = load_robot(scenario.robot)
    common = copy.deepcopy(scenario)
    common.description, common.robot, common.seed = "", robot.name, 0
    common.mechanisms = AS_IN_PARAMETERS
    for push in common.pushes:
        push.delta_v, push.force, push.direction_deg = 0.0, None, 0.0
        push.time, push.phase = 0.0, None
        push.side, push.fraction = Push.side, Push.fraction
    return _digest([yaml_dump_typed(common).encode(), *_files(robot)])


def robot_hash(name: str) -> str:
    """Returns 16 hex digits for the files of a robot, wherever they are.

    Raises:
        ValueError: the robot is unknown or makes no sense.
        FileNotFoundError: a file of the robot is missing.
    """
    return _digest(_files(load_robot(name)))


def this_code() -> dict[str, str]:
    """Returns what a row depends on, apart from its scenario and its robot."""
    return {**versions(), "code": code_hash()}


def code_hash(root: Path = MODELS.parent) -> str:
    """Returns 16 hex digits for the files under `root` that trials use."""
    trials = root / "diagrams"
    paths = [
        *(
            path
            for folder in (root / "nadia_balance", root / "models")
            for ending in ("py", "yaml", "urdf")
            for path in folder.rglob(f"*.{ending}")
        ),
        *trials.glob("*.py"),
        *(p for p in trials.glob("envelope/*.py") if p.name in TRIAL_FILES),
    ]
    files = {path.relative_to(root).as_posix(): path for path in paths}
    return _digest(
        part
        for name, path in sorted(files.items())
        for part in (name.encode(), path.read_bytes())
    )


def _files(robot: RobotModel) -> tuple[bytes, bytes]:
    params, urdf = yaml_dump_typed(robot.params), robot.urdf
    return params.encode(), urdf.read_text(encoding="utf-8").encode()


def _digest(parts: Iterable[bytes]) -> str:
    whole = hashlib.sha256()
    for part in parts:
        whole.update(hashlib.sha256(part).digest())
    return whole.hexdigest()[:16]
