"""Editors accept what we accept.  Oracles: jsonschema; the package's files."""

import jsonschema
import pytest
import yaml

from json_schema import json_schema, named_schema
from nadia_balance.diagrams.scenario import SCENARIO_FOLDER, Scenario
from nadia_balance.robot.params import MODELS, RobotParams

ROBOT = jsonschema.Draft202012Validator(json_schema(RobotParams))
SCENARIOS = jsonschema.Draft202012Validator(named_schema(Scenario, ""))


def problems(validator, text: str) -> list[str]:
    """Where the YAML has them: paths."""
    errors = validator.iter_errors(yaml.safe_load(text))
    return [".".join(map(str, error.absolute_path)) for error in errors]


def test_the_files_of_the_package_are_valid():
    robots = sorted(MODELS.glob("*/robot.yaml"))
    scenarios = sorted(SCENARIO_FOLDER.glob("*.yaml"))
    assert robots and scenarios
    for path in robots:
        assert problems(ROBOT, path.read_text("utf-8")) == [], path
    for path in scenarios:
        assert problems(SCENARIOS, path.read_text("utf-8")) == [], path


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("a: {sed: 1}", "a"),
        ("a: {seed: 1.5}", "a.seed"),
        ("a: {duration: 0}", "a.duration"),
        ("a: {engine: bullet}", "a.engine"),
        ("a: {pushes: [{delta_v: -1}]}", "a.pushes.0.delta_v"),
        ("a: {controller: {step_adjuster: {x: 1}}}", "a.controller.step_"),
    ],
)
def test_what_is_wrong_is_shown_at_its_place(text, place):
    """Oracle: by hand; the reader refuses the same."""
    (problem,) = problems(SCENARIOS, text)
    assert problem.startswith(place)


def test_a_field_has_its_meaning_and_its_default():
    properties = json_schema(Scenario)["properties"]
    assert properties["duration"]["description"] == "of the run [s]"
    assert properties["duration"]["default"] == 10.0
    assert "sources" not in properties
