"""What README.md and docs/ say of the code is true."""

import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass

import pytest
import yaml

from diagrams.scenario import Scenario, load_scenario
from nadia_balance.core.robot_params import RobotParams
from tests.source_files import ROOT, python_files

README = (ROOT / "README.md").read_text(encoding="utf-8")
DIAGRAM = (ROOT / "docs" / "diagram.md").read_text(encoding="utf-8")
ROBOT = (ROOT / "docs" / "robot.md").read_text(encoding="utf-8")


def blocks(text: str, language: str) -> list[str]:
    """The code in this language in a Markdown `text`."""
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_the_controller_works_in_ones_own_diagram():
    """Oracle: she stands; without torques she sinks by 15 cm meanwhile."""
    (block,) = blocks(DIAGRAM, "python")
    names = {}
    exec(compile(block, "diagram.md", "exec"), names)
    plant, simulator = names["plant"], names["simulator"]
    context = plant.GetMyContextFromRoot(simulator.get_context())
    start = plant.GetPositions(context)[6]
    simulator.AdvanceTo(0.2)
    assert plant.GetPositions(context)[6] == pytest.approx(start, abs=0.005)


def test_the_table_has_every_system():
    """Oracle: the classes in the source files."""
    sources = "".join(
        (ROOT / path).read_text("utf-8")
        for path in python_files("nadia_balance/systems")
    )
    systems = re.findall(r"^class (\w+)\(LeafSystem\)", sources, re.MULTILINE)
    rows = re.findall(r"^\| `(\w+)` \|", README, re.MULTILINE)
    assert len(systems) > 10
    assert set(systems) <= set(rows)


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "docs"])
def test_links_lead_somewhere(name):
    """Oracle: the files of the checkout."""
    path = ROOT / name
    for file in path.glob("*.md") if path.is_dir() else [path]:
        text = file.read_text(encoding="utf-8")
        for link in re.findall(r"\]\((?!https?:|#)([^)#]+)", text):
            assert (file.parent / link).exists(), link


def values(params: object, prefix: str = "") -> Iterator[tuple[str, object]]:
    """Every field of a dataclass, here and below, and its value."""
    for field in fields(params):
        value = getattr(params, field.name)
        if is_dataclass(value):
            yield from values(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, value


def test_the_table_has_every_field_of_robot_yaml_and_its_default():
    """Oracle: the dataclasses; what is required has nothing to start with."""
    row = r"^\| `([\w.]+)` \|[^|]*\| ([^|]*?) \|[^|]*\|$"
    table = dict(re.findall(row, ROBOT, re.MULTILINE))
    defaults = dict(values(RobotParams()))
    assert set(table) == set(defaults)
    for name, value in defaults.items():
        if table[name] == "required":
            assert not value, name
        else:
            text = f"{value:g}" if isinstance(value, float) else str(value)
            assert table[name] == text, name


def test_the_scenario_of_a_small_robot_is_one(tmp_path):
    """Oracle: it loads; each length is half of the default, for Nadia."""
    (text,) = blocks(ROBOT, "yaml")
    file = tmp_path / "push.yaml"
    file.write_text(text)
    assert load_scenario("half_size_push", file).robot.endswith("robot.yaml")
    given = yaml.safe_load(text)["half_size_push"]["controller"]
    lengths = dict(leaves(given, Scenario().controller))
    assert len(lengths) > 20
    for name, (length, of_nadia) in lengths.items():
        if not name.endswith("step_length_factor"):
            assert length == pytest.approx(0.5 * of_nadia, rel=0.02), name


def leaves(tree: dict, params: object) -> Iterator[tuple[str, tuple]]:
    """Every number of `tree`, beside that of the dataclass `params`."""
    for name, value in tree.items():
        other = getattr(params, name)
        if isinstance(value, dict):
            for leaf, pair in leaves(value, other):
                yield f"{name}.{leaf}", pair
        else:
            yield name, (value, other)
