"""push-v1: the pushes by which controllers are compared.

What is fixed here is fixed for ever: other pushes, or other files of a robot,
are another protocol with another name.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from nadia_balance.core.walking.mechanisms import MOST
from nadia_balance.diagrams.scenario import (
    AT,
    STANDING,
    Command,
    Scenario,
    load_scenario,
)
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.params import MODELS
from nadia_balance.sweep.search import SearchParams, Sweep

NAME = "push-v1"
WALKING = "walking"  # scenario of a robot that walks at SPEED
IN_PLACE = "push"  # scenario of a robot that steps in place, or stands
SPEED = 0.5  # forward [m/s]
STEADY = 8  # steps after which it walks at SPEED
LONGER = 1.4  # times the duration in place
MOMENTS = (AT, "right swing 50 %", "right swing 75 %", "left transfer 50 %")
# The files of each robot, by their sha256.
ROBOTS: dict[str, dict[str, str]] = {
    "nadia": {
        "robot.yaml": "1852405db645c43e94cce49b5e546c44"
        "1d7051350dc27b35d65157230d4bd2c9",
        "nadia.urdf": "bc7823113f4fc19a926a293a0df024fc"
        "cb16183bb1b6f9e62da8016a1d17c192",
    },
    "g1": {
        "robot.yaml": "3ec7bb035a5b09693d3f5e587ff04ec8"
        "982060b32aa86116de5bae0e41621933",
        "g1.urdf": "53f2949aa1280d80ddd215e9f57e6894"
        "8530550654767145ec1c51caeedfda87",
    },
    "atlas": {
        "robot.yaml": "88793cd64b00c22d40ba2be59403ca70"
        "c14d54c052e15178230718d0dc6aa755",
        "atlas.urdf": "64f59349322c5fa28f1aaa6ecac839f6"
        "5194b67ffc83d229b45593ade77540d1",
    },
}


class Part(NamedTuple):
    """A sweep of the protocol.

    Attributes:
        scenario: IN_PLACE, or WALKING.
        fidelity: of the drives.
        engine: of the physics.
        at: moments of the push.
    """

    scenario: str
    fidelity: str
    engine: str
    at: tuple[str, ...]

    @property
    def name(self) -> str:
        """The name of its folder."""
        return f"{self.scenario}_{self.fidelity}_{self.engine}"


@dataclass(frozen=True, kw_only=True)
class Variant:
    """How much of the protocol is measured.

    Attributes:
        parts: its sweeps.
        directions: all around.
        search: of each limit.
    """

    parts: tuple[Part, ...]
    directions: int
    search: SearchParams = field(default_factory=SearchParams)


FULL, QUICK = "full", "quick"
VARIANTS = {
    FULL: Variant(
        parts=(
            Part(IN_PLACE, "realistic", "drake", (*MOMENTS, STANDING)),
            Part(WALKING, "realistic", "drake", (AT,)),
            Part(IN_PLACE, "ideal", "drake", (AT, STANDING)),
            Part(IN_PLACE, "realistic", "mujoco", (AT, STANDING)),
        ),
        directions=12,
        search=SearchParams(resolution=0.05, stride=4, replicas=3),
    ),
    QUICK: Variant(
        parts=(Part(IN_PLACE, "realistic", "drake", (AT, STANDING)),),
        directions=4,
        search=SearchParams(resolution=0.1, stride=4, replicas=1),
    ),
}


def sweeps(
    variant: str,
    robot: str,
    controller: str = "",
    blocks: Mapping[str, str] | None = None,
    contract: tuple[str, ...] = (),
) -> dict[str, Sweep]:
    """The sweeps of a row.

    Args:
        variant: FULL or QUICK.
        robot: one of ROBOTS.
        controller: file of a policy, or `module:Class`; "": ours.
        blocks: `module:Class` by role, in the place of our blocks.
        contract: of a policy, files and fields (see policy.contract).

    Returns:
        The sweeps by the names of their folders, checked.

    Raises:
        ValueError: the robot is not one of ROBOTS, or its files are others.
    """
    check_robot(robot, robot_files(robot))
    of_variant = VARIANTS[variant]
    step = 360.0 / of_variant.directions
    made = {}
    for part in of_variant.parts:
        sweep = Sweep(
            scenarios={part.scenario: scenario_of(part, robot)},
            controller=controller,
            blocks=dict(blocks or {}),
            contract=contract,
            directions=tuple(i * step for i in range(of_variant.directions)),
            at=part.at,
            mechanisms=(MOST,),
            search=of_variant.search,
        )
        sweep.validate()
        made[part.name] = sweep
    return made


def scenario_of(part: Part, robot: str) -> Scenario:
    """The scenario of a part.

    Args:
        part: of the protocol.
        robot: a model's name.

    Returns:
        The scenario, with one push.
    """
    scenario = load_scenario(
        IN_PLACE, robot=robot, fidelity=part.fidelity, engine=part.engine
    )
    if part.scenario == IN_PLACE:
        return scenario
    (push,) = scenario.pushes
    return scenario.walking_by(Command(forward=SPEED)).changed(
        duration=LONGER * scenario.duration,
        pushes=[replace(push, after_steps=STEADY)],
    )


def sha256(path: Path) -> str:
    """Hashes a file, as the program sha256sum does.

    Args:
        path: of the file.

    Returns:
        64 hex digits.
    """
    return hashlib.sha256(path.read_bytes()).hexdigest()


def robot_files(robot: str) -> dict[str, str]:
    """The hashes of a robot's files.

    Args:
        robot: a model's name.

    Returns:
        The sha256 of its robot.yaml and its URDF, by the files' names; none of
        a robot that is not one of ROBOTS.
    """
    return {
        name: sha256(MODELS / robot / name) for name in ROBOTS.get(robot, ())
    }


def check_robot(robot: str, files: Mapping[str, str]) -> None:
    """Checks that a robot is that of the protocol.

    Args:
        robot: its name.
        files: the sha256 of its files, by name.

    Raises:
        ValueError: names the robot, or the file, and both hashes.
    """
    require(
        robot in ROBOTS,
        f"robot = {robot!r}: must be one of {', '.join(ROBOTS)} with {NAME}",
    )
    for name, digest in ROBOTS[robot].items():
        require(
            files.get(name) == digest,
            f"robot = {robot!r}: sha256 of {name} = {files.get(name)}: must "
            f"be {digest} with {NAME}",
        )
