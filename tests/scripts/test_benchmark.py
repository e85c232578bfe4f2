"""The benchmark: what it measures, and what it refuses."""

import csv
import json
from contextlib import redirect_stdout
from io import StringIO
from unittest.mock import patch

import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.core.math import qp
from nadia_balance.diagrams.simulation import start
from nadia_balance.scripts import benchmark
from nadia_balance.scripts.benchmark import tick_time
from tests.diagrams.simulated import diagram_of, scenario_of


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """The file of records, and one short run, as --json prints it."""
    recorded = tmp_path_factory.mktemp("speed") / "speed.csv"
    argv = "--mechanisms all_with_cross_over --json --seconds 0.2"
    argv += f" --record {recorded}"
    out = StringIO()
    early = patch.multiple(benchmark, TICKS=20, START=0.1)
    with early, redirect_stdout(out):
        assert benchmark.main(argv.split()) == 0
    return recorded, json.loads(out.getvalue())


def test_the_figures_are_those_of_the_loop_and_the_plants(told):
    """Oracle: the ratio's definition.

    Which of two is faster is not asserted: other work disturbs any clock.
    """
    _, figures = told
    loop, plant = figures["closed_loop_x_real_time"], "plant_in_loop"
    ratio = loop / figures[f"{plant}_x_real_time"]
    assert figures[f"loop_over_{plant}"] == pytest.approx(ratio)
    assert 0.0 < figures["tick_median_us"] <= figures["tick_p99_us"]


def test_a_record_has_a_row_for_each_run(told):
    """Oracle: the figures; a second run adds a row under the same head."""
    recorded, figures = told
    benchmark.record(recorded, scenario_of(), figures)
    with recorded.open(encoding="utf-8", newline="") as file:
        first, second = csv.DictReader(file)
    assert first["mechanisms"] == "all_with_cross_over"
    assert second["mechanisms"] == "icp_only"
    for row in first, second:
        found = [float(row[name]) for name in figures]
        assert found == pytest.approx([*figures.values()], rel=1e-3)


def test_measures_a_whole_tick_of_the_controller():
    """Oracle: both quadratic programs of its update are solved anew."""
    diagram = diagram_of("{gait: {num_steps: 2}}")
    loop = start(diagram)
    loop.AdvanceTo(0.1)
    solve = qp.solve_arrays
    with patch.object(qp, "solve_arrays", autospec=True) as solved:
        solved.side_effect = solve
        tick_time(Simulator(diagram.controller), loop.get_context())
    assert solved.call_count == 2
