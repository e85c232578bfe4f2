"""Scenarios: robot, walking command, pushes and all parameters of a run."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_load_file

from nadia_balance.balance_controller import ControllerParams
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.plan.footstep_plan import velocity_limits
from nadia_balance.core.plan.gait import Gait, walking_start
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.mechanisms import ATLAS_MECHANISMS, NAMED
from nadia_balance.core.walking.push import Moment, Push, random_pushes
from nadia_balance.diagrams.terrain import FLAT, Terrain
from nadia_balance.parameters.bounds import bounded, check
from nadia_balance.parameters.scaling import scaled
from nadia_balance.parameters.yaml_reader import load_tree, load_typed
from nadia_balance.robot.model import (
    FIDELITIES,
    RobotModel,
    load_robot,
    load_robot_params,
)
from nadia_balance.robot.params import load_sensors
from nadia_balance.systems.estimation import FILTERS
from nadia_balance.systems.hardware import Imperfections

SCENARIO_FOLDER = Path(__file__).parent / "scenarios"
UNITS = ("si", "froude")
AT = "right swing 25 %"  # of the Nadia paper's Fig. 10
STANDING = "standing"  # of set_push: with no steps at all, at STANDING_AT
STANDING_AT = "1 s"
# Directions [deg] relative to a left stance foot (a right swing).
DIRECTIONS = dict(forward=0.0, inward=90.0, backward=180.0, outward=270.0)
ENGINES = ("drake", "mujoco")
SENSORS = ("perfect", "industrial", "consumer")


@dataclass(kw_only=True)
class Place:
    """Where the robot stands at the start: its middle, in W."""

    x: float = bounded(0.0, least=-4e3, most=4e3, unit="m", of="")
    y: float = bounded(0.0, least=-4e3, most=4e3, unit="m", of="")
    yaw_deg: float = bounded(0.0, least=-360.0, most=360.0)  # to the left

    @property
    def pose(self) -> walking.FootPose:
        """The level frame between the feet."""
        p_WF = np.array([self.x, self.y, 0.0])
        return walking.FootPose(p_WF, math.radians(self.yaw_deg))


@dataclass(kw_only=True)
class Command:
    """The velocity that is commanded from a time on."""

    time: float = bounded(0.0, least=0.0, most=3600.0, unit="s", of="")
    forward: float = bounded(0.0, least=-10.0, most=10.0, unit="m/s")
    left: float = bounded(0.0, least=-10.0, most=10.0, unit="m/s")
    # To the left.
    turn: float = bounded(0.0, least=-10.0, most=10.0, unit="rad/s")


@dataclass(kw_only=True)
class Scenario:
    """One run, deterministic in the scenario and its seed."""

    description: str = ""  # a line for the user
    robot: str = "nadia"  # a folder of models, or a robot.yaml
    # Units of the values in its file: SI, or "froude": for a robot of Nadia's
    # size (core/math/bounds.py).  Defaults are always in froude units.
    units: str = bounded("si", one_of=UNITS)
    # Limits of a real robot, or ideal drives (see robot.model.FIDELITIES).
    fidelity: str = bounded("realistic", one_of=FIDELITIES)
    engine: str = bounded("drake", one_of=ENGINES)  # of the physics
    # perfect: the controller is given the state.  Others (models/sensors)
    # measure, and a StateEstimator gives it an estimate.
    sensors: str = bounded("perfect", one_of=SENSORS)
    # Its filter: a Kalman filter, or fixed gains (docs/sensors.md).
    estimator: str = bounded("invariant", one_of=tuple(FILTERS))
    duration: float = bounded(10.0, above=0.0, most=3600.0, unit="s")
    # 0: the exact start; otherwise it is shifted by up to 10 um.
    seed: int = bounded(0, least=0, most=2**32 - 1)
    # Recovery mechanisms that are on.
    mechanisms: str = bounded("icp_only", one_of=tuple(NAMED))
    # Whole steps with an ICP error below 5 cm that a recovery requires.
    calm_steps: int = bounded(0, least=0, most=100)
    # Largest torso tilt of a recovery; not used with `ideal` fidelity.
    max_torso_tilt_deg: float = bounded(
        45.0, above=0.0, most=90.0, unit="deg", of=""
    )
    # Control period of the point mass.  At 0.01 the largest pushes are those at
    # controller.control_period, and the simulation is faster.
    lipm_period: float = bounded(0.01, least=0.0005, most=0.02, unit="s", of="")
    # Time step of the physics engine; it divides controller.control_period.
    time_step: float = bounded(0.001, least=1e-5, most=0.1, unit="s", of="")
    # Model errors and measurement errors unknown to the controller.
    imperfections: Imperfections = field(default_factory=Imperfections)
    terrain: Terrain = field(default_factory=Terrain)
    place: Place = field(default_factory=Place)
    gait: Gait = field(default_factory=Gait)
    controller: ControllerParams = field(default_factory=ControllerParams)
    pushes: list[Push] = field(default_factory=list)
    # Velocity commands, for a gait without steps of its own.
    commands: list[Command] = field(default_factory=list)
    # Largest of the pushes in random directions, one every `random_pause`; 0:
    # none.
    random_delta_v: float = bounded(0.0, least=0.0, most=10.0, unit="m/s")
    random_pause: float = bounded(10.0, least=1.0, most=3600.0, unit="s", of="")
    # Share of the largest commands up to which a random one comes every second.
    random_commands: float = bounded(0.0, least=0.0, most=1.0)

    def point_mass(self, robot: RobotModel) -> PointMassModel:
        """The controller's model of `robot` and of the ground (see Terrain)."""
        terrain, place = self.terrain, self.place.pose
        ground = terrain.ground(robot.sole, robot.params.size)
        ground = terrain.known(ground, place.p_WF[:2])
        return replace(robot.point_mass, ground=ground)

    @property
    def delay(self) -> float:
        """The delay [s] from measurement to controller."""
        if self.sensors == "perfect":
            return self.imperfections.delay
        return self.imperfections.delay + load_sensors(self.sensors).delay

    def start(self, model: PointMassModel) -> walking.WalkingState:
        """The walking state of the standing `model` at the start."""
        return walking_start(self.gait, model, self.place.pose)

    def validate_more(self) -> None:
        """Raises ValueError if fields contradict each other."""
        for name, why in self._contradictions():
            value = attrgetter(name)(self)
            raise ValueError(f"{name} = {value!r}: must {why}")
        period, own = self.controller.control_period, self.imperfections.delay
        walking.whole_ticks("imperfections.delay", own, period)
        delay = f"sensors = {self.sensors!r}: its delay"
        walking.whole_ticks(delay, self.delay, period)
        for push in self.pushes:
            moment = push.moment
            if moment.phase is None and not moment.time < self.duration:
                raise ValueError(
                    f"at = {push.at!r}: must be before duration = "
                    f"{self.duration} s"
                )
        times = [command.time for command in self.commands]
        for i, (last, time) in enumerate(itertools.pairwise(times), 1):
            if time <= last:
                raise ValueError(
                    f"commands[{i}].time = {time}: must be later than {last} s"
                )

    def _contradictions(self) -> Iterator[tuple[str, str]]:
        """Fields that do not fit the others, and what they must do."""
        period, errors = self.controller.control_period, self.imperfections
        ticks, tick = period / self.time_step, f"control_period = {period} s"
        if ticks < 1 or abs(ticks - round(ticks)) > 1e-9:
            yield "time_step", f"divide controller.{tick}"
        if self.duration < period:
            yield "duration", f"be >= controller.{tick}"
        if self.sensors != "perfect" and errors.has_noise:
            yield "sensors", "be 'perfect' with noise in imperfections"
        for name in ("friction_ratio", "torso_mass_ratio"):
            if self.engine == "mujoco" and getattr(errors, name) != 1.0:
                yield f"imperfections.{name}", "be 1 with engine = mujoco"
        if self.commands or self.random_commands:
            for name in ("num_steps", "steps", "footholds"):
                if getattr(self.gait, name):
                    yield f"gait.{name}", "not come with commands"
        qp = "controller.icp_step_qp"
        if self.controller.icp_step_qp is None:
            if self.mechanisms in ATLAS_MECHANISMS:
                yield "mechanisms", f"go with {qp}, whose they are"
        elif NAMED[self.mechanisms].cross_over:
            yield "mechanisms", f"not let the legs cross with {qp}"
        elif self.terrain.name != FLAT:
            yield "terrain.name", f"be {FLAT} with {qp}: it knows no regions"


def scenario_names() -> dict[str, Path]:
    """The scenarios that come with the package, by name."""
    files = sorted(SCENARIO_FOLDER.glob("*.yaml"))
    return {name: path for path in files for name in yaml_load_file(str(path))}


def load_scenario(
    name: str,
    filename: str | Path | None = None,
    text: str | None = None,
    **changes: object,
) -> Scenario:
    """Returns the scenario `name` of the package, or of the file.

    `text` is YAML that overrides single fields, and so do `changes` that are
    not None; both are in SI units, and so is the returned scenario: default
    values, and those of a file whose `units` are "froude", have been scaled
    from Nadia's size to that of the robot.

    Raises ValueError: unknown name or field, malformed YAML, a value out of
    range; FileNotFoundError: the file does not exist.
    """
    what = f"scenario_file = {filename}"
    if filename is None:
        known = scenario_names()
        if name not in known:
            which = f"must be one of {', '.join(known)}"
            raise ValueError(f"scenario_name = {name!r}: {which}")
        what, filename = "scenario", known[name]
    elif not Path(filename).is_file():
        raise FileNotFoundError(f"{what}: no such file")
    scenario = load_typed(Scenario, what, filename=filename, child_name=name)
    given: dict = {}
    if scenario.units == "si":
        given = load_tree(Path(filename).read_text(encoding="utf-8"), name)
    if text:
        over = {"data": text, "defaults": scenario}
        scenario = load_typed(Scenario, "scenario_text", **over)
        tree = load_tree(text)
        if "units" in tree:
            why = "must be in a scenario_file; scenario_text is in SI units"
            raise ValueError(f"units = {tree['units']!r}: {why}")
        given = _merged(given, tree)
    changes = {k: v for k, v in changes.items() if v is not None}
    for field_name, value in changes.items():
        if field_name not in Scenario.__dataclass_fields__:
            raise ValueError(f"{field_name}: must be a field of a Scenario")
        setattr(scenario, field_name, value)
    check(scenario)
    size = load_robot_params(scenario.robot)[0].size
    scenario.units = "si"
    scenario = scaled(scenario, size, given | changes)
    check(scenario)
    _draw(scenario)
    return scenario


def _draw(scenario: Scenario) -> None:
    """Adds the random pushes and commands, which its seed determines."""
    duration, seed = scenario.duration, scenario.seed
    if largest := scenario.random_delta_v:
        pause, scenario.random_delta_v = scenario.random_pause, 0.0
        count = int(duration / pause)
        more = random_pushes(count, seed, largest, (pause, pause))
        in_time = (p for p in more if p.moment.time < duration)
        scenario.pushes.extend(in_time)
    if share := scenario.random_commands:
        scenario.random_commands = 0.0
        model = load_robot(scenario.robot, scenario.fidelity).point_mass
        limits = velocity_limits(scenario.controller.footstep_planner, model)
        rng = np.random.default_rng([seed, 1])  # not that of the pushes
        for second in range(1, math.ceil(duration)):
            forward, left, turn = (share * rng.uniform(*limits)).tolist()
            row = Command(time=second, forward=forward, left=left, turn=turn)
            scenario.commands.append(row)


def set_push(
    scenario: Scenario,
    direction: str | float | None = None,
    delta_v: float | None = None,
    at: str | None = None,
    shape: str | None = None,
) -> None:
    """Changes what is not None in the first push of the `scenario`; checks it.

    A scenario without a push gets one of `delta_v`: if `at` is None, at AT, or
    at 1 s for a robot that only stands.
    `direction` is in degrees, or one of DIRECTIONS, seen from the stance foot;
    `delta_v` in [m/s]; `at` as `Push.at`, or STANDING; `shape` as `Push.shape`.

    Raises ValueError: neither push nor `delta_v`, or a value is invalid.
    """
    if not scenario.pushes and delta_v is None:
        raise ValueError("pushes = []: must have a push, or delta_v be given")
    if not scenario.pushes:
        walks = scenario.gait.has_steps or scenario.commands
        scenario.pushes = [Push(at=AT if walks else STANDING_AT)]
    push = scenario.pushes[0]
    if shape is not None:
        push.shape = shape
    if delta_v is not None:
        push.delta_v, push.force = delta_v, None
    if at == STANDING:
        let_stand(scenario)
    elif at is not None:
        push.at = str(Moment.parse(at))
    if direction in DIRECTIONS:
        mirrored = push.moment.swing is walking.Side.LEFT
        push.direction_deg = DIRECTIONS[direction] * (-1.0 if mirrored else 1.0)
    elif direction is not None:
        try:
            push.direction_deg = float(direction)
        except ValueError:
            which = f"must be degrees, or one of {', '.join(DIRECTIONS)}"
            raise ValueError(f"direction = {direction!r}: {which}") from None
    check(scenario)


def let_stand(scenario: Scenario) -> None:
    """Removes the steps and commands; the first push is at STANDING_AT."""
    scenario.gait = Gait(step_width=scenario.gait.step_width)
    scenario.commands = []
    scenario.pushes[0].at = STANDING_AT


def _merged(tree: object, over: object) -> Any:
    """The YAML tree `tree` with the leaves and lists of `over` replaced."""
    if not (isinstance(tree, dict) and isinstance(over, dict)):
        return over
    return tree | {key: _merged(tree.get(key), over[key]) for key in over}
