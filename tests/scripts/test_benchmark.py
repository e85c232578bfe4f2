"""The benchmark: what it measures, and what it refuses."""

import csv
import json
from contextlib import redirect_stdout
from io import StringIO
from unittest.mock import patch

import pytest

from nadia_balance.diagrams.tick_replay import record_push
from nadia_balance.scripts import benchmark
from tests.diagrams.simulated import scenario_of
from tests.scripts.running import assert_refused, run_script

PUSH = "{gait: {num_steps: 2}, pushes: [{delta_v: 0.1, at: 0.02 s}]}"


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """The file of records, and one short run, as --json prints it."""
    recorded = tmp_path_factory.mktemp("speed") / "speed.csv"
    argv = f"--json --seconds 0.2 --record {recorded}"
    out = StringIO()
    early = patch.multiple(benchmark, START=0.1, REPLAYS=1, AFTER=0.2)
    with early, redirect_stdout(out):
        assert benchmark.main(argv.split()) == 0
    return recorded, json.loads(out.getvalue())


def test_the_figures_are_those_of_loop_plant_and_ticks(told):
    """Oracles: the ratio's definition, order statistics of the same times.

    Which of two is faster is not asserted: other work disturbs any clock.
    """
    _, figures = told
    loop, plant = (
        figures[f"{name}_x_real_time"]
        for name in ("closed_loop", "plant_alone")
    )
    assert loop > 0.0 and plant > 0.0
    assert figures["control_period_ms"] == 4.0
    assert 0.0 < figures["tick_median_us"] <= figures["tick_p99_us"]
    assert figures["push_median_us"] <= figures["push_p99_us"]
    assert figures["push_p99_us"] <= figures["push_worst_us"]
    assert figures["moving_median_us"] <= figures["moving_worst_us"]
    assert figures["moving_worst_us"] <= figures["push_worst_us"]


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


def test_a_record_keeps_rows_that_have_other_columns(tmp_path):
    """Oracle: the rows as they were written, by hand."""
    path = tmp_path / "speed.csv"
    path.write_text("commit,older_us\nabc,12\n", encoding="utf-8")
    benchmark.record(path, scenario_of(), {"newer_us": 3.4})
    with path.open(encoding="utf-8", newline="") as file:
        first, second = csv.DictReader(file)
    assert first["commit"] == "abc" and first["older_us"] == "12"
    assert not first["newer_us"] and not second["older_us"]
    assert second["newer_us"] == "3.4"


@pytest.mark.parametrize(
    "content", [b"# Title\n\nHello, world\n", b"\xff\xfe", b'{"a": 1}\n2\n']
)
def test_a_record_is_no_other_file(tmp_path, capsys, content):
    """Oracle: the bytes of before; nothing is measured."""
    path = tmp_path / "notes.txt"
    path.write_bytes(content)
    outcome = run_script(benchmark, ["--record", path], capsys)
    assert_refused(outcome, f"record = {path}: must be a CSV of this program")
    assert path.read_bytes() == content


def test_refuses_ticks_that_are_not_those_of_the_loop():
    """Oracle: an input that was changed by hand."""
    scenario = scenario_of(PUSH)
    ticks = record_push(scenario, 0.02)
    assert benchmark.replayed(scenario, ticks).shape == ticks.pushed.shape
    ticks.inputs[3]["estimated_state"][4] += 1e-9
    with pytest.raises(RuntimeError, match="replayed torques differ by"):
        benchmark.replayed(scenario, ticks)
