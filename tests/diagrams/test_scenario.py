"""Scenarios: all of them load, and none that is wrong gets through."""

import copy
import dataclasses
import math
import types
import typing

import pytest
from pydrake.common.yaml import (
    yaml_dump_typed,
    yaml_load_data,
    yaml_load_file,
    yaml_load_typed,
)

from diagrams.scenario import (
    SCENARIO_FOLDER,
    Scenario,
    load_scenario,
    scenario_names,
)
from diagrams.start import initial_walking_state
from nadia_balance.core.gait import StepVector

FILES = sorted(SCENARIO_FOLDER.glob("*.yaml"))


@pytest.mark.parametrize("name", scenario_names())
def test_every_scenario_loads_and_has_its_steps_in_reach(name):
    """Oracle: the validation, and the footsteps that are made from it."""
    scenario = load_scenario(name)
    assert scenario.description
    state = initial_walking_state(scenario)
    assert bool(state.schedule.footsteps) == (scenario.gait.num_steps > 0)


def test_no_two_files_have_a_scenario_of_one_name():
    """Oracle: the number of names in the files, without ours."""
    names = [name for path in FILES for name in yaml_load_file(str(path))]
    assert sorted(names) == sorted(scenario_names())
    assert len(FILES) >= 2


def test_a_scenario_may_keep_all_the_defaults(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("Defaults: {}\n")
    loaded = load_scenario("Defaults", path)
    assert yaml_dump_typed(loaded) == yaml_dump_typed(Scenario())


def test_one_of_everything_survives_dump_and_load():
    """Oracle: every leaf is another than its default, and comes back."""
    everything = changed(Scenario, Scenario())
    text = yaml_dump_typed(everything, child_name="OneOfEverything")
    loaded = yaml_load_typed(
        schema=Scenario, data=text, child_name="OneOfEverything"
    )
    dumps = [
        leaves(yaml_load_data(yaml_dump_typed(scenario)))
        for scenario in (everything, loaded, Scenario())
    ]
    assert dumps[0] == dumps[1]
    same = set(dumps[0].items()) & set(dumps[2].items())
    assert same == set()
    assert set(dumps[0]) >= set(dumps[2])


def test_one_of_everything_from_a_file(tmp_path):
    """Oracle: the text, field by field."""
    path = tmp_path / "mine.yaml"
    path.write_text(ONE_OF_EVERYTHING)
    loaded = load_scenario("OneOfEverything", path)
    assert loaded.description == "one of everything"
    assert (loaded.duration, loaded.seed) == (7.5, 3)
    assert loaded.plant_config.time_step == 0.0005
    assert loaded.plant_config.contact_model == "point"  # the default stays
    assert loaded.gait.steps == [StepVector(length=0.2), StepVector(yaw_deg=5)]
    assert loaded.controller.control_period == 0.004
    assert loaded.controller.balance.feedback_gain == 2.5
    first, second = loaded.pushes
    assert (first.phase, first.fraction, first.force) == ("swing", 0.5, 100.0)
    assert (second.time, second.delta_v, second.body) == (5, 0.1, "TORSO_LINK")


ONE_OF_EVERYTHING = """
Other: {duration: 3.0}
OneOfEverything:
  description: one of everything
  robot: nadia
  duration: 7.5
  seed: 3
  mechanisms: icp_only
  plant_config: {time_step: 0.0005}
  gait:
    steps: [{length: 0.2}, {yaw_deg: 5.0}]
    step_width: 0.3
  controller:
    control_period: 0.004
    balance: {feedback_gain: 2.5}
  pushes:
  - {force: 100.0, phase: swing, side: left, fraction: 0.5, duration: 0.2}
  - {delta_v: 0.1, time: 5.0, body: TORSO_LINK, direction_deg: 45.0}
"""


def test_text_overrides_single_fields():
    loaded = load_scenario("push", text="{seed: 4, gait: {step_width: 0.3}}")
    plain = load_scenario("push")
    assert (loaded.seed, loaded.gait.step_width) == (4, 0.3)
    assert loaded.gait.num_steps == plain.gait.num_steps
    assert yaml_dump_typed(plain.pushes[0]) == yaml_dump_typed(loaded.pushes[0])


# What is wrong, and how the message begins: field = value: must ...
BAD_TEXTS = {
    "seed: -1": "seed = -1: must be >= 0",
    "required_steps: -1": "required_steps = -1: must be >= 0",
    "lipm_period: .nan": "lipm_period = nan: must be in [0.0005, 0.02] s",
    "lipm_period: 0.03": "lipm_period = 0.03: must be in [0.0005, 0.02] s",
    "duration: .nan": "duration = nan: must be finite",
    "duration: .inf": "duration = inf: must be finite",
    "duration: -1": "duration = -1.0: must be",
    "duration: 0.001": "duration = 0.001: must be",  # half a tick
    "mechanisms: luck": "mechanisms = 'luck': must be one of icp_only",
    "plant_config: {time_step: -1}": "time_step = -1.0: must be",
    "plant_config: {time_step: 0}": "time_step = 0.0: must be",
    "plant_config: {time_step: .nan}": "time_step = nan: must be",
    "plant_config: {time_step: 0.0015}": "time_step = 0.0015: must divide",
    "plant_config: {time_step: 0.004}": "time_step = 0.004: must divide",
    "plant_config: {penetration_allowance: -1}": (
        "penetration_allowance = -1.0: must be"
    ),
    # Drake would end the process.
    "plant_config: {stiction_tolerance: 0}": "stiction_tolerance = 0.0: must",
    "plant_config: {sap_near_rigid_threshold: -1}": (
        "sap_near_rigid_threshold = -1.0: must be"
    ),
    "plant_config: {contact_model: magic}": (
        "contact_model = 'magic': must be one of point"
    ),
    "plant_config: {discrete_contact_approximation: magic}": (
        "discrete_contact_approximation = 'magic': must be one of"
    ),
    "controller: {control_period: .nan}": "control_period = nan: must be in",
    "controller: {control_period: 0}": "control_period = 0.0: must be in",
    "controller: {balance: {feedback_gain: .nan}}": (
        "feedback_gain = nan: must be > 1"
    ),
    "controller: {walking_state_machine: {contact_impulse: -1}}": (
        "contact_impulse = -1.0: must be finite and >= 0"
    ),
    "controller: {com_height: {position_gain: -1}}": "position_gain = -1.0: ",
    "controller: {swing_foot: {height: -1}}": "height = -1.0: must be in",
    "gait: {num_steps: -1}": "num_steps = -1: must be >= 0",
    "gait: {step_width: .nan}": "step_width = nan: must be in",
    "gait: {swing_duration: -0.7}": "swing_duration = -0.7: must be in",
    "gait: {first_swing: middle}": (
        "first_swing = 'middle': must be left or right"
    ),
    "gait: {step: {yaw_deg: .inf}}": "step.yaw_deg = inf: must be finite",
    "pushes: [{time: 1.0}]": "delta_v = None, force = None: must give exactly",
    "pushes: [{force: 1.0}]": "time = None, phase = None: must give exactly",
    "pushes: [{delta_v: -0.1, time: 1.0}]": "delta_v = -0.1: must be finite",
    "pushes: [{delta_v: .nan, time: 1.0}]": "delta_v = nan: must be finite",
    "pushes: [{delta_v: 0.1, time: 1.0, direction_deg: .inf}]": (
        "direction_deg = inf: must be finite"
    ),
    "pushes: [{delta_v: 0.1, time: 10.0}]": (
        "time = 10.0: must be < duration = 10.0 s"
    ),
    "pushes: [{delta_v: 0.1, phase: swing}]": (
        "phase = 'swing': must come with steps in the gait"
    ),
}


@pytest.mark.parametrize("text", BAD_TEXTS)
def test_a_value_out_of_range_is_refused_by_its_name(text):
    with pytest.raises(ValueError) as error:
        load_scenario("stand", text=text)
    assert str(error.value).startswith(BAD_TEXTS[text])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nonsense: 1", "nonsense: unknown field, must be one of desc"),
        ("gait: {step: {foo: 1}}", "gait.step.foo: unknown field, must be"),
        ("duration: abc", "duration = 'abc': must be a number"),
        ("seed: 1.5", "seed = 1.5: must be an integer"),
        ("robot: 3", "robot = 3: must be text"),
        ("gait: 3", "gait = 3: must be a mapping"),
        ("gait: [1]", "gait = [1]: must be a mapping"),
        ("pushes: 3", "pushes = 3: must be a list"),
        ("pushes: [3]", "pushes[0] = 3: must be a mapping"),
        ("gait: {num_steps: .nan}", "gait.num_steps = nan: must be an int"),
    ],
)
def test_a_field_of_the_wrong_kind_is_refused_by_its_name(text, message):
    with pytest.raises(ValueError) as error:
        load_scenario("stand", text=text)
    assert str(error.value).startswith(f"scenario_text: {message}")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text", ["{", "a: b: c", "- 1", "3", "null", "\t", "&a : *b"]
)
def test_malformed_text_is_refused(text):
    with pytest.raises(ValueError, match="^scenario_text: "):
        load_scenario("stand", text=text)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"mine: {duration: [1\n", "malformed YAML: line 2"),
        (b"", "malformed YAML: must be a mapping of names"),
        (b"- 1\n", "malformed YAML: must be a mapping of names"),
        (b"\xff\xfe\x00", "'utf-8' codec can't decode"),
        (b"other: {}\n", "'mine': must be one of other"),
        (b"mine: 3\n", "mine = 3: must be a mapping"),
        (b"mine:\n", "mine = None: must be a mapping"),
        (b"mine: {nonsense: 1}\n", "mine.nonsense: unknown field"),
    ],
)
def test_a_bad_file_is_refused(tmp_path, content, why):
    path = tmp_path / "mine.yaml"
    path.write_bytes(content)
    with pytest.raises(ValueError) as error:
        load_scenario("mine", path)
    assert str(error.value).startswith(f"scenario_file = {path}: {why}")
    assert "\n" not in str(error.value)


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(ValueError) as error:
        load_scenario("walk_on_water")
    message = "scenario_name = 'walk_on_water': must be one of "
    assert str(error.value) == message + ", ".join(scenario_names())


@pytest.mark.parametrize("name", ["nowhere.yaml", "."])
def test_a_file_that_is_none_is_refused(tmp_path, name):
    path = tmp_path / name
    with pytest.raises(FileNotFoundError) as error:
        load_scenario("mine", path)
    assert str(error.value) == f"scenario_file = {path}: no such file"


def changed(schema, value):
    """Another value of the same type: no leaf is what it was."""
    origin, args = typing.get_origin(schema), typing.get_args(schema)
    if origin in (types.UnionType, typing.Union):
        some = next(arg for arg in args if arg is not type(None))
        return changed(some, some() if value is None else value)
    if origin is list:
        return [changed(args[0], args[0]())]
    if origin is dict:
        return {"some key": changed(args[1], args[1]())}
    if schema is bool:
        return not value
    if schema is str:
        return f"{value} other"
    if schema in (int, float):
        return schema(value + 1) if math.isfinite(value) else 1.0
    result = copy.deepcopy(value)
    for name, kind in field_types(schema).items():
        setattr(result, name, changed(kind, getattr(value, name)))
    return result


def field_types(schema) -> dict:
    """Name -> type of the fields of a dataclass, or of Drake's configs."""
    if dataclasses.is_dataclass(schema):
        return typing.get_type_hints(schema)
    return {field.name: field.type for field in schema.__fields__}


def leaves(node, path=()) -> dict:
    """Path -> value of all that is no mapping and no list."""
    if isinstance(node, dict):
        children = node.items()
    elif isinstance(node, list):
        children = enumerate(node)
    else:
        return {path: node}
    return {
        key: leaf
        for name, child in children
        for key, leaf in leaves(child, (*path, name)).items()
    }
