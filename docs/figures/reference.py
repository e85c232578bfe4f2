"""Writes docs/reference.md: flags, scenarios, summary.json, log.npz.

All names, defaults and bounds are those of the code; a test compares the page
with what this script writes.

Examples:
    python docs/figures/reference.py
"""

import contextlib
import dataclasses
import importlib
import inspect
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn
from unittest import mock

from json_schema import complete, json_schema, named_schema
from nadia_balance.core.feedback.icp_step_qp import IcpStepQpParams
from nadia_balance.core.plan.gait import Foothold, StepVector
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.push import Push
from nadia_balance.diagrams.scenario import (
    Command,
    Scenario,
    load_scenario,
    scenario_names,
)
from nadia_balance.parameters.bounds import UNBOUNDED, meaning
from nadia_balance.policy.params import ObservationTerm, PolicyParams
from nadia_balance.results.log import VIEWS
from nadia_balance.robot.params import RobotParams
from nadia_balance.scripts.command_line import DONE, CommandLine, say
from nadia_balance.sweep.row import Row

PAGE = Path(__file__).parents[1] / "reference.md"
SCRIPTS = (
    "push",
    "simulate",
    "envelope",
    "single_pushes",
    "tour",
    "estimate",
    "new_robot",
    "benchmark",
    "export_mcap",
    "control",
    "robot",
)
# Entries of summary.json: unit, and what it is.
SUMMARY = {
    "outcome": ("", "recovered (also stood, walked), failed or undecided"),
    "recovered": ("", "true if `outcome` is recovered"),
    "reason": ("", "of another outcome: the first criterion that is not met"),
    "fell_at": ("s", "when it had fallen"),
    "robot": ("", "the folder of models, or the robot.yaml"),
    "mechanisms": ("", "by which it may recover, or the file of a policy"),
    "scenario": ("", "the scenario's name"),
    "plant": ("", "humanoid, or lipm (a point mass)"),
    "fidelity": ("", "realistic, or ideal drives"),
    "engine": ("", "drake or mujoco"),
    "seed": ("", "of the shift of the start"),
    "direction_deg": ("deg", "of its first push: 0 forward, 90 left"),
    "delta_v": ("m/s", "of its first push"),
    "duration_s": ("s", "of the log: of a long run, its last chapter"),
    "pushes": ("", "each push as it came, see below"),
    "estimate": ("", "errors of the estimated state (docs/sensors.md)"),
    "body_sway_deg": (
        "deg",
        "largest tilt of the line from between the soles to the CoM",
    ),
    "max_torso_tilt_deg": ("deg", "largest angle of the torso to the vertical"),
    "max_pelvis_tilt_deg": ("deg", "the same, of the pelvis"),
    "com_sag_m": ("m", "largest loss of the CoM's height over the lower sole"),
    "max_icp_error_m": ("m", "largest distance of the ICP from its reference"),
    "footstep_error_m": ("m", "largest distance of a landing from its goal"),
    "swing_durations_s": ("s", "of each completed swing"),
    "transfer_durations_s": ("s", "of each completed transfer"),
    "steps_taken": ("", "landings in the log"),
    "steps_after_push": ("", "landings since the last push began"),
    "calm_steps": ("", "whole steps at the end with an ICP error below 5 cm"),
    "stance_slip_m": ("m", "largest way of a stance foot over the ground"),
    "touchdowns": (
        "",
        "of each foot that meets the ground: its side; speed of the lowest "
        "corner along the ground and down [m/s]; tilt [rad]. Time before the "
        "end of the swing [s]; force in a step of the plant, and over 10 ms "
        "[body weights]; slide in 0.1 s [m]",
    ),
    "max_landing_speed": ("m/s", "largest `speed_along` of the touchdowns"),
    "max_landing_force": ("1", "largest `mean_force` of the touchdowns"),
    "max_torque_ratio": (
        "1",
        "largest torque over its limit; the QP holds the limit, so that 1 is "
        "usual, first in the arms, whose swing turns the trunk",
    ),
    "max_torque_step": ("N m", "largest change of a torque in a control tick"),
    "torque_step_ratio": (
        "1",
        "change of a torque in a tick over its limit: of the worst joint, the "
        "median of all ticks",
    ),
    "max_joint_speed": ("rad/s", "of the fastest joint"),
    "max_joint_speed_ratio": ("1", "largest joint speed over its limit"),
    "max_power_w": ("W", "largest power of all drives together, net"),
    "positive_power_w": ("W", "the same, those that brake not counted"),
    "mean_swing_foot_speed": ("m/s", "of a sole's centre, the fastest swing"),
    "max_impact_body_weights": ("1", "largest force on a foot over the weight"),
    "min_sole_distance_m": ("m", "between soles that pass, from above"),
    "min_edge_distances_m": (
        "m",
        "of each landed sole from the edge of its region; negative: beside it",
    ),
    "qp_failures": ("", "ticks without a solution: the joints are damped"),
    "qp_fallbacks": (
        "",
        "ticks in which Clarabel solved what DAQP did not: the solution is as "
        "good, and took longer",
    ),
    "max_qp_violation": ("of the row", "largest violation of a constraint"),
    "recovery_time_s": ("s", "from the last push until the ICP error is back"),
    "required_calm_steps": (
        "",
        "the scenario's `calm_steps`; a robot that stands needs none",
    ),
    "missed_pushes": ("", "pushes that had not ended at the end of the run"),
    "improper_contacts": ("", "what touched, other than a foot the ground"),
    "self_contacts": ("", "those of two of the robot's own links"),
    "real_time_factor": ("1", "simulated time over the time of the processor"),
    "versions": ("", "of Python and of the packages that determine a run"),
}
PUSHES = {
    "time_s": ("s", "begin"),
    "duration_s": ("s", "length"),
    "delta_v": ("m/s", "impulse over the robot's mass"),
    "direction_deg": ("deg", "from the support foot's heading, 90 left"),
    "force_n": ("N", "largest force"),
    "impulse_n_s": ("N s", "as it was felt"),
    "absorbed_energy_j": ("J", "work on the CoM"),
}
# Arrays of log.npz that have no named columns; n ticks, nu actuators.
ARRAYS = {
    "t": ("(n,) s", "the control ticks"),
    "icp": ("(n, 2) m", "instantaneous capture point, xy in W"),
    "momentum_rate": ("(n, 3) N", "commanded change of linear momentum, in W"),
    "foot_wrenches": (
        "(n, 12) N m, N",
        "planned torque and force on the left, then the right foot, in W",
    ),
    "swing_foot_reference": (
        "(n, 12) m, rad, s",
        "position, velocity, acceleration of the sole; yaw and its derivatives",
    ),
    "actuation": ("(n, nu) N m", "commanded torques, in the actuators' order"),
    "torques": ("(n, nu) N m", "torques of the drives"),
    "state": ("(n, nq + nv)", "positions and velocities of Drake's plant"),
    "mechanisms": (
        "(n, 4) 0 or 1",
        ", ".join(f.name for f in dataclasses.fields(Mechanisms)),
    ),
    "no_foothold": (
        "(n, 1) 0 or 1",
        "1: no ground in reach is in the capture region",
    ),
    "step_forces": (
        "(n, 2 m) N",
        "upward on left and right foot in each of the m steps of the plant "
        "since the last tick, the latest first",
    ),
    "imu": (
        "(n, 9) rad/s, m/s^2, rad/s",
        "mean angular velocity and specific force, latest angular velocity",
    ),
    "joints": ("(n, 2 nj) rad, rad/s", "angles and speeds, by the encoders"),
    "estimated_state": ("(n, nq + nv)", "`state` as the estimator says"),
    "estimate_covariance": (
        "(n, 81) rad, m/s, m",
        "(9, 9), of the pelvis's angle, velocity and position, in W",
    ),
    "sole": ("(4, 2) m", "corners of a sole, in its frame"),
    "weight": ("() N", "of the robot"),
    "actuator_names": ("(nu,)", "names"),
    "velocity_limits": (
        "(2, 3) m/s, rad/s",
        "least and most of a command, if its source is one's own",
    ),
    "effort_limits": ("(nu,) N m", "limits of torque"),
    "joint_speed_limits": ("(nu,) rad/s", "limits of speed"),
    "joint_speed_columns": ("(nu,)", "of the joints' speeds in `state`"),
    "capture_regions": (
        "(k, 4) s, -, m",
        "with Meshcat, corners of C_1 and C_N, 16 times a second of a swing: "
        "time, n, x, y",
    ),
    "region_base": ("(k, 2) m", "reach of the next step, legs not crossed"),
    "region_forward": ("(k, 2) m", "the same, crossing in front"),
    "region_backward": ("(k, 2) m", "the same, crossing behind"),
    "ground": ("(k, 3)", "number of a region; x, y [m] of each of its corners"),
}


def table(*rows: tuple[object, ...]) -> Iterator[str]:
    """Makes a Markdown table.

    Args:
        *rows: cells; the first row is its head.

    Yields:
        Its lines.
    """
    for i, row in enumerate(rows):
        cells = (" ".join(str(cell).split()) for cell in row)
        yield f"| {' | '.join(c.replace('|', '/') for c in cells)} |"
        if i == 0:
            yield "|---" * len(row) + "|"


def parser_of(script: str) -> CommandLine:
    """Takes the parser of a script, with all of its flags.

    Args:
        script: its name.

    Returns:
        The parser with which it would read the command line.
    """
    parsers: list[CommandLine] = []

    def take(parser: CommandLine, *_: object) -> NoReturn:
        parsers.append(parser)
        parser.exit()

    module = importlib.import_module(f"nadia_balance.scripts.{script}")
    with (
        mock.patch.object(CommandLine, "parse_args", take),
        contextlib.suppress(SystemExit),
    ):
        module.main([])
    return parsers[0]


def flags(script: str) -> Iterator[str]:
    """Lists the flags of a script, and what they are for.

    Args:
        script: its name.

    Yields:
        Lines of Markdown.
    """
    parser = parser_of(script)
    rows = []
    for action in parser._actions:
        if "--help" not in action.option_strings:
            names = "`, `".join(action.option_strings) or action.dest
            text = action.help and parser._get_formatter()._expand_help(action)
            if action.choices:
                text = f"{text}: {', '.join(map(str, action.choices))}"
            rows.append((f"`{names}`", text))
    yield f"### {script}.py\n"
    yield (parser.description or "").partition("\n\n")[0] + "\n"
    yield from table(("flag", ""), *rows)
    yield f"\n{parser.epilog}\n" if parser.epilog else ""


def scenarios() -> Iterator[str]:
    """Lists the scenarios of the package.

    Yields:
        Lines of Markdown.
    """
    named = {name: load_scenario(name) for name in scenario_names()}
    yield from table(
        ("scenario", "", "robot", "mechanisms"),
        *(
            (f"`{name}`", one.description, one.robot, one.mechanisms)
            for name, one in named.items()
        ),
    )


def fields(prefix: str, params: Any) -> Iterator[tuple[str, str, str, str]]:
    """Lists the fields of a dataclass, then those of dataclasses in it.

    Args:
        prefix: of their names.
        params: a dataclass with its defaults.

    Yields:
        Name, default, rule and meaning.
    """
    nested = []
    for field in dataclasses.fields(params):
        value = getattr(params, field.name)
        if dataclasses.is_dataclass(value):
            nested.append((f"{prefix}{field.name}.", value))
        elif not field.metadata.get("internal"):
            bounds = field.metadata.get("bounds", UNBOUNDED)
            rule = ", ".join(bounds.one_of)
            if not rule and (
                type(value) in (float, int) or bounds != UNBOUNDED
            ):
                rule = bounds.rule(0.0)
            default = "" if value is None or value == [] else str(value)
            yield f"`{prefix}{field.name}`", default, rule, meaning(field)
    for name, value in nested:
        yield from fields(name, value)


def logged() -> Iterator[tuple[str, str, str]]:
    """Lists the arrays of log.npz.

    Yields:
        Name, shape and meaning.
    """
    for name, (shape, words) in ARRAYS.items():
        yield f"`{name}`", shape, words
    for name, view in VIEWS.items():
        columns = ", ".join(view.get_fields())
        words, _, _ = (inspect.getdoc(view) or "").partition("\n\n")
        if view.__module__ == "builtins" or "namedview" in words.lower():
            words = ""
        yield (
            f"`{name}`",
            f"(n, {len(view.get_fields())})",
            f"{columns}. {words}".strip(),
        )


def page() -> str:
    """Writes the whole page.

    Returns:
        Its text.
    """
    lines = [
        "# Reference\n",
        "For whoever looks up a flag, a scenario, a field or a signal. "
        "`python docs/figures/reference.py` writes this page from the code.\n",
        "## Flags\n",
        *(line for script in SCRIPTS for line in flags(script)),
        "## Scenarios\n",
        *scenarios(),
        "\n## Fields of a scenario\n",
        "Defaults of `controller` are Nadia's; those of another robot are "
        "scaled by its size.\n",
        *table(
            ("field", "default", "must be", ""),
            *fields("", Scenario()),
            *fields("gait.steps[].", StepVector()),
            *fields("gait.footholds[].", Foothold()),
            *fields("pushes[].", Push()),
            *fields("commands[].", Command()),
            *fields("controller.icp_step_qp.", IcpStepQpParams()),
        ),
        "\n## Fields of a policy.yaml\n",
        "The contract of a learned policy ([policy](policy.md)).\n",
        *table(
            ("field", "default", "must be", ""),
            *fields("", PolicyParams()),
            *fields("observation[].", ObservationTerm()),
        ),
        "\n## summary.json\n",
        "Null where it does not apply.\n",
        *table(
            ("field", "unit", ""),
            *((f"`{name}`", *words) for name, words in SUMMARY.items()),
        ),
        "\nEach of `pushes`:\n",
        *table(
            ("field", "unit", ""),
            *((f"`{name}`", *words) for name, words in PUSHES.items()),
        ),
        "\n## log.npz\n",
        "Row i of an array (n, ...) holds at `t[i]`. What a robot or a "
        "controller lacks is not there.\n",
        *table(("array", "shape, unit", "columns"), *logged()),
    ]
    return "\n".join(lines) + "\n"


def schemas() -> dict[str, str]:
    """The JSON schemas of the package's YAML, for editors, and of a row.

    Returns:
        Their texts, by the names of their files in docs.
    """
    made = {
        "robot.schema.json": json_schema(RobotParams, "robot.yaml"),
        "scenario.schema.json": named_schema(Scenario, "a file of scenarios"),
        "row.schema.json": complete(json_schema(Row, "a row of the league")),
    }
    return {
        name: f"{json.dumps(schema, indent=1)}\n"
        for name, schema in made.items()
    }


def main(argv: list[str] | None = None) -> int:
    """Writes the page, and the schemas beside it.

    Args:
        argv: the command line; None: that of the process.

    Returns:
        The exit code.
    """
    CommandLine(__file__, __doc__, "0 written, 2 bad input.").parse_args(argv)
    PAGE.write_text(page(), encoding="utf-8")
    say(f"wrote {PAGE}")
    for name, text in schemas().items():
        PAGE.with_name(name).write_text(text, encoding="utf-8")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
