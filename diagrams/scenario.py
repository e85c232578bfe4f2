"""Scenarios: robot, walking command, pushes and all parameters of a run."""

import copy
import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from numbers import Real
from operator import attrgetter
from pathlib import Path
from typing import Any, Self

import numpy as np

from nadia_balance.balance_controller import ControllerParams
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.plan.footstep_plan import velocity_limits
from nadia_balance.core.plan.gait import Gait, walking_start
from nadia_balance.core.walking.mechanisms import ATLAS_MECHANISMS, NAMED
from nadia_balance.core.walking.push import Moment, Push, random_pushes
from nadia_balance.core.walking.state import (
    FootPose,
    Side,
    WalkingState,
    whole_ticks,
)
from nadia_balance.diagrams.terrain import Terrain
from nadia_balance.parameters.bounds import bounded, check, parameters, require
from nadia_balance.parameters.layers import Layer, merged
from nadia_balance.parameters.yaml_reader import (
    check_types,
    field_types,
    load_tree,
    naming,
    typed,
)
from nadia_balance.parameters.yaml_writer import dump
from nadia_balance.results.landing import LandingLimits
from nadia_balance.robot.model import (
    FIDELITIES,
    RobotModel,
    load_robot,
    load_robot_params,
    whole_body_tree,
)
from nadia_balance.robot.params import IDEAL_WHOLE_BODY, load_sensors
from nadia_balance.systems.estimation import FILTERS
from nadia_balance.systems.hardware import Imperfections

SCENARIO_FOLDER = Path(__file__).parent / "scenarios"
AT = "right swing 25 %"  # of the Nadia paper's Fig. 10
STANDING = "standing"  # of with_push: with no steps at all, at STANDING_AT
STANDING_AT = "1 s"
TEXT = "scenario_text"  # source of what a text has set
# Fields from which load_scenario derives others.
OF_LOADING = frozenset(
    (
        "robot",
        "units",
        "fidelity",
        "random_delta_v",
        "random_pause",
        "random_commands",
    )
)
# Directions [deg] relative to a left stance foot (a right swing).
DIRECTIONS = dict(forward=0.0, inward=90.0, backward=180.0, outward=270.0)
SENSORS = ("perfect", "industrial", "consumer", "proprioceptive")


@parameters
class Place:
    """Where the robot stands at the start: its middle, in W."""

    x: float = bounded(
        0.0, least=-4e3, most=4e3, unit="m", of="", doc="forward"
    )
    y: float = bounded(
        0.0, least=-4e3, most=4e3, unit="m", of="", doc="to the left"
    )
    yaw_deg: float = bounded(
        0.0, least=-360.0, most=360.0, doc="turn to the left, in degrees"
    )

    @property
    def pose(self) -> FootPose:
        """The level frame between the feet."""
        return FootPose(
            np.array([self.x, self.y, 0.0]), math.radians(self.yaw_deg)
        )


@parameters
class Command:
    """The velocity that is commanded from a time on."""

    time: float = bounded(
        0.0, least=0.0, most=3600.0, unit="s", of="", doc="its begin"
    )
    forward: float = bounded(
        0.0, least=-10.0, most=10.0, unit="m/s", doc="forward"
    )
    left: float = bounded(
        0.0, least=-10.0, most=10.0, unit="m/s", doc="to the left"
    )
    turn: float = bounded(
        0.0, least=-10.0, most=10.0, unit="rad/s", doc="turn to the left"
    )


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One run, deterministic in the scenario and its seed.

    It is not changed: `with_push` and the like return another one.
    """

    description: str = bounded("", doc="a line for the user")
    robot: str = bounded("nadia", doc="a folder of models, or a robot.yaml")
    units: str = bounded(
        "si",
        one_of=("si", "froude"),
        doc='of the values in its file: SI, or "froude" for a robot of '
        "Nadia's size, as the defaults are",
    )
    fidelity: str = bounded(
        "realistic",
        one_of=FIDELITIES,
        doc="limits of a real robot, or ideal drives and feet",
    )
    engine: str = bounded(
        "drake", one_of=("drake", "mujoco"), doc="of the physics"
    )
    sensors: str = bounded(
        "perfect",
        one_of=SENSORS,
        doc="perfect: the controller is given the state; others (models/"
        "sensors) measure, and a StateEstimator gives it an estimate",
    )
    estimator: str = bounded(
        "invariant",
        one_of=tuple(FILTERS),
        doc="its filter: a Kalman filter, or fixed gains (docs/sensors.md)",
    )
    duration: float = bounded(
        10.0, above=0.0, most=3600.0, unit="s", doc="of the run"
    )
    seed: int = bounded(
        0,
        least=0,
        most=2**32 - 1,
        doc="of all that is random; 0: the exact start, otherwise it is "
        "shifted by up to 10 um",
    )
    mechanisms: str = bounded(
        "icp_only", one_of=tuple(NAMED), doc="of recovery, that are on"
    )
    calm_steps: int = bounded(
        0,
        least=0,
        most=100,
        doc="whole steps with an ICP error below 5 cm that a recovery requires",
    )
    max_torso_tilt_deg: float = bounded(
        45.0,
        above=0.0,
        most=90.0,
        unit="deg",
        of="",
        doc="largest tilt of the torso in a recovery; not used if ideal",
    )
    landing: LandingLimits = bounded(
        LandingLimits, doc="hardest landing of a recovery; not used if ideal"
    )
    lipm_period: float = bounded(
        0.01,
        least=0.0005,
        most=0.02,
        unit="s",
        of="",
        doc="control period of the point mass; at 0.01 its largest pushes are "
        "those at controller.control_period, and it is faster",
    )
    time_step: float = bounded(
        0.001,
        least=1e-5,
        most=0.1,
        unit="s",
        of="",
        doc="of the physics engine; it divides controller.control_period",
    )
    imperfections: Imperfections = bounded(
        Imperfections,
        doc="errors of model and measurement, unknown to the controller",
    )
    terrain: Terrain = bounded(Terrain, doc="the ground")
    place: Place = bounded(Place, doc="where the robot starts")
    gait: Gait = bounded(Gait, doc="the steps, if they are planned before")
    controller: ControllerParams = bounded(
        ControllerParams, doc="of the controller"
    )
    pushes: list[Push] = bounded(list, doc="in any order")
    commands: list[Command] = bounded(
        list, doc="of velocity, for a gait without steps of its own"
    )
    random_delta_v: float = bounded(
        0.0,
        least=0.0,
        most=10.0,
        unit="m/s",
        doc="largest of the pushes in random directions; 0: none",
    )
    random_pause: float = bounded(
        10.0,
        least=1.0,
        most=3600.0,
        unit="s",
        of="",
        doc="from one random push to the next",
    )
    random_commands: float = bounded(
        0.0,
        least=0.0,
        most=1.0,
        doc="share of the largest commands up to which a random one comes "
        "every second",
    )
    # By the path of each value that is not a default (see parameters.layers).
    sources: Mapping[str, str] = field(
        default_factory=dict,
        compare=False,
        repr=False,
        metadata={"internal": True},
    )

    def period(self, plant: str) -> float:
        """The control period.

        Args:
            plant: "humanoid" or "lipm".

        Returns:
            The period [s].
        """
        if plant == "lipm":
            return self.lipm_period
        return self.controller.control_period

    def point_mass(self, robot: RobotModel) -> PointMassModel:
        """Returns the controller's model of the robot on this ground.

        Args:
            robot: the robot of this scenario.

        Returns:
            The model of capture-point control.
        """
        ground = self.terrain.known(
            self.terrain.ground(robot.sole, robot.params.size),
            start=self.place.pose.p_WF[:2],
        )
        return replace(robot.point_mass, ground=ground)

    @property
    def delay(self) -> float:
        """The delay [s] from measurement to controller."""
        return self.imperfections.delay + (
            0.0
            if self.sensors == "perfect"
            else load_sensors(self.sensors).delay
        )

    @property
    def _estimates_foot_forces(self) -> bool:
        return (
            self.sensors != "perfect"
            and load_sensors(self.sensors).foot_forces == "estimated"
        )

    def start(self, model: PointMassModel) -> WalkingState:
        """Returns the walking state of the standing robot at the start.

        Args:
            model: the robot on its ground (see point_mass).

        Returns:
            Both feet carry, and no step has begun.
        """
        return walking_start(self.gait, model, self.place.pose)

    def with_push(
        self,
        direction: str | float | None = None,
        delta_v: float | None = None,
        at: str | None = None,
        shape: str | None = None,
    ) -> Self:
        """Returns this scenario with another first push.

        A scenario without a push gets one of `delta_v`: if `at` is None, at AT,
        or at STANDING_AT for a robot that only stands.

        Args:
            direction: degrees, or one of DIRECTIONS, seen from the stance foot.
            delta_v: change of the robot's velocity [m/s].
            at: as `Push.at`; or STANDING: without steps, at STANDING_AT.
            shape: as `Push.shape`.  Each is as it was if None.

        Returns:
            Another scenario, checked.

        Raises:
            ValueError: neither push nor `delta_v`, or a value is invalid.
        """
        for name, value, kinds, words in (
            ("direction", direction, str | Real, "degrees, or a name"),
            ("delta_v", delta_v, Real, "a number"),
            ("at", at, str, "a moment in words"),
            ("shape", shape, str, "a name"),
        ):
            is_good = isinstance(value, kinds) and not isinstance(value, bool)
            require(
                value is None or is_good, f"{name} = {value!r}: must be {words}"
            )
        require(
            bool(self.pushes) or delta_v is not None,
            "pushes = []: must have a push, or delta_v be given",
        )
        if at == STANDING:
            return self.standing().with_push(direction, delta_v, None, shape)
        first, *others = copy.deepcopy(self.pushes) or [
            Push(at=AT if self.gait.has_steps or self.commands else STANDING_AT)
        ]
        if shape is not None:
            first.shape = shape
        if delta_v is not None:
            first.delta_v, first.force = delta_v, None
        if at is not None:
            first.at = str(Moment.parse(at))
        if direction is not None:
            first.direction_deg = _degrees(direction, first.moment)
        return self.changed(pushes=[first, *others])

    def standing(self) -> Self:
        """Returns this scenario without steps.

        It stands as wide as the robot does, or it would step to that width.
        Its first push, if it has one, is at STANDING_AT.

        Returns:
            Another scenario, checked.

        Raises:
            ValueError: it has commands, or its text steps.
        """
        require(
            not self.commands,
            f"at = {STANDING}: must come without a command to walk",
        )
        self._require_no_steps(f"at = {STANDING}")
        pushes = copy.deepcopy(self.pushes)
        for push in pushes[:1]:
            push.at = STANDING_AT
        return self.changed(gait=Gait(), pushes=pushes)

    def walking_by(self, command: Command) -> Self:
        """Returns this scenario with one command in the place of all steps.

        Args:
            command: that of the whole run.

        Returns:
            Another scenario, checked.

        Raises:
            ValueError: its text has steps.
        """
        self._require_no_steps("commands")
        return self.changed(
            gait=replace(self.gait, num_steps=0, steps=[], footholds=[]),
            commands=[command],
        )

    def _require_no_steps(self, other: str) -> None:
        """ValueError: a text has set steps, which `other` would drop."""
        for name in ("num_steps", "steps", "footholds"):
            value = getattr(self.gait, name)
            require(
                not value or self.sources.get(f"gait.{name}") != TEXT,
                f"gait.{name} = {value!r}: must not come with {other}",
            )

    def changed(self, **fields: Any) -> Self:
        """Returns this scenario with other values, checked.

        Args:
            **fields: those of a Scenario, in SI units.  Pushes and commands at
                random stay those that load_scenario has drawn.

        Returns:
            Another scenario.

        Raises:
            ValueError: names a field that there is not, its bad value, or one
                on which others depend: those of load_scenario.
        """
        check_types(type(self), fields)
        for name in OF_LOADING & {*fields}:
            require(
                fields[name] == getattr(self, name),
                f"{name} = {fields[name]!r}: must be given to load_scenario",
            )
        sources = {
            path: source
            for path, source in self.sources.items()
            if path.partition(".")[0] not in fields
        } | dict.fromkeys(fields, "flag")
        changed = replace(self, **fields, sources=sources)
        check(changed)
        return changed

    def as_yaml(self, name: str) -> str:
        """Returns this scenario as the YAML of a scenario file.

        Where a value is not a default, its source stands beside it.

        Args:
            name: under which it stands in the file.

        Returns:
            The text of the file.
        """
        return dump(self, name, comments=self.sources)

    def validate_more(self) -> None:
        """Checks the conditions between fields.

        Raises:
            ValueError: fields contradict each other.
        """
        for name, rule in self._contradictions():
            raise ValueError(
                f"{name} = {attrgetter(name)(self)!r}: must {rule}"
            )
        period = self.controller.control_period
        whole_ticks("imperfections.delay", self.imperfections.delay, period)
        whole_ticks(
            f"sensors = {self.sensors!r}: its delay", self.delay, period
        )
        for push in self.pushes:
            moment = push.moment
            require(
                moment.phase is not None or moment.time < self.duration,
                f"at = {push.at!r}: must be before duration = "
                f"{self.duration} s",
            )
        times = [command.time for command in self.commands]
        for i, (last, time) in enumerate(itertools.pairwise(times), 1):
            require(
                time > last,
                f"commands[{i}].time = {time}: must be later than {last} s",
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
        if self.fidelity == "ideal" and self._estimates_foot_forces:
            yield "sensors", "measure foot forces if ideal: it has no drives"
        for name in ("friction_ratio", "torso_mass_ratio"):
            if self.engine == "mujoco" and getattr(errors, name) != 1.0:
                yield f"imperfections.{name}", "be 1 with engine = mujoco"
        if self.commands or self.random_commands:
            for name in ("num_steps", "steps", "footholds"):
                if getattr(self.gait, name):
                    yield f"gait.{name}", "not come with commands"
        if self.commands and self.random_commands:
            yield "random_commands", "not come with commands"
        qp = "controller.icp_step_qp"
        if self.controller.icp_step_qp is None:
            if self.mechanisms in ATLAS_MECHANISMS:
                yield "mechanisms", f"go with {qp}, whose they are"
        elif NAMED[self.mechanisms].cross_over:
            yield "mechanisms", f"not let the legs cross with {qp}"


def scenario_names() -> dict[str, Path]:
    """Returns the package's scenarios.

    Returns:
        Their files, by their names.
    """
    return {
        name: path
        for path in sorted(SCENARIO_FOLDER.glob("*.yaml"))
        for name in load_tree(path.read_text(encoding="utf-8"))
    }


def load_scenario(
    name: str,
    filename: str | Path | None = None,
    text: str | None = None,
    **changes: object,
) -> Scenario:
    """Returns a scenario of the package, or of a file.

    The layers are those of parameters.layers: default by size < robot.yaml <
    fidelity < scenario < scenario_text < flag.

    Args:
        name: of the scenario.
        filename: YAML with named scenarios; None: those of the package.
        text: YAML that overrides single fields, in SI units.
        **changes: fields of a Scenario, in SI units; None: not given.

    Returns:
        The scenario in SI units: defaults, and a file's values whose `units`
        are "froude", have been scaled from Nadia's size to the robot's.

    Raises:
        ValueError: unknown name or field, malformed YAML, a value out of range.
        FileNotFoundError: the file does not exist.
    """
    layers = list(_layers_of_user(name, filename, text, changes))
    chosen = typed(
        Scenario,
        {
            key: layer.tree[key]
            for layer in layers
            for key in ("robot", "fidelity")
            if key in layer.tree
        },
    )
    check(chosen)
    ideal = IDEAL_WHOLE_BODY if chosen.fidelity == "ideal" else {}
    robot_layers = [
        Layer("robot.yaml", _of_whole_body(whole_body_tree(chosen.robot))),
        Layer("fidelity", _of_whole_body(ideal)),
    ]
    scenario, sources = merged(
        Scenario,
        load_robot_params(chosen.robot)[0].size,
        [*robot_layers, *layers],
    )
    return _with_random(replace(scenario, units="si", sources=sources))


def _of_whole_body(tree: Mapping[str, object]) -> dict[str, object]:
    return {"controller": {"whole_body": tree}} if tree else {}


def _layers_of_user(
    name: str,
    filename: str | Path | None,
    text: str | None,
    changes: Mapping[str, object],
) -> Iterator[Layer]:
    """The layers of load_scenario from the scenario on, with checked types."""
    source = f"scenario_file = {filename}"
    if filename is None:
        names = scenario_names()
        require(
            name in names,
            f"scenario_name = {name!r}: must be one of {', '.join(names)}",
        )
        source, filename = "scenario", names[name]
    elif not Path(filename).is_file():
        raise FileNotFoundError(f"{source}: no such file")
    with naming(source):
        tree = load_tree(Path(filename).read_text(encoding="utf-8"), name)
        check_types(Scenario, tree, name)
    yield Layer("scenario", tree, tree.get("units") == "froude")
    if text is not None:
        with naming(TEXT):
            tree = load_tree(text)
            check_types(Scenario, tree)
        require(
            "units" not in tree,
            f"units = {tree.get('units')!r}: must be in a scenario_file; "
            "scenario_text is in SI units",
        )
        yield Layer(TEXT, tree)
    fields = {key: value for key, value in changes.items() if value is not None}
    for key in fields:
        require(
            key in field_types(Scenario),
            f"{key}: must be a field of a Scenario",
        )
    yield Layer("flag", fields)


def _with_random(scenario: Scenario) -> Scenario:
    """Adds the random pushes and commands, which its seed determines."""
    duration, seed = scenario.duration, scenario.seed
    if largest := scenario.random_delta_v:
        pause = scenario.random_pause
        drawn = random_pushes(
            int(duration / pause), seed, largest, (pause, pause)
        )
        scenario = replace(
            scenario,
            pushes=[
                *scenario.pushes,
                *(push for push in drawn if push.moment.time < duration),
            ],
            random_delta_v=0.0,
        )
    if share := scenario.random_commands:
        limits = velocity_limits(
            scenario.controller.footstep_planner,
            load_robot(scenario.robot, scenario.fidelity).point_mass,
        )
        rng = np.random.default_rng([seed, 1])  # not that of the pushes
        count = max(math.ceil(duration) - 1, 0)
        velocities = share * rng.uniform(limits[0], limits[1], (count, 3))
        scenario = replace(
            scenario,
            commands=[
                *scenario.commands,
                *(
                    Command(time=second, forward=forward, left=left, turn=turn)
                    for second, (forward, left, turn) in enumerate(
                        velocities.tolist(), start=1
                    )
                ),
            ],
            random_commands=0.0,
        )
    return scenario


def _degrees(direction: str | float, moment: Moment) -> float:
    """A direction [deg] of a push at this moment, by number or by name."""
    if direction in DIRECTIONS:
        return DIRECTIONS[direction] * (
            -1.0 if moment.swing is Side.LEFT else 1.0
        )
    try:
        return float(direction)
    except ValueError:
        raise ValueError(
            f"direction = {direction!r}: must be degrees, or one of "
            f"{', '.join(DIRECTIONS)}"
        ) from None
