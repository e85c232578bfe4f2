"""The benchmark: what it measures, and what it refuses."""

import json
import math

import pytest

from scripts import benchmark
from tests.scripts.running import assert_refused, run_script

BLOCKS = {
    "balance_controller",
    "centroidal_estimator",
    "walking_state_machine",
    "icp_planner",
    "timing_adapter",
    "step_adjuster",
    "momentum_qp",
    "swing_foot_planner",
    "whole_body_inverse_dynamics",
}


ARGV = ["--mechanisms", "all_with_cross_over"]


@pytest.fixture(scope="module")
def figures():
    """One short run, as --json prints it."""
    lines = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("builtins.print", lines.append)
        assert benchmark.main([*ARGV, "--json", "--seconds", "0.2"]) == 0
    return json.loads("\n".join(lines))


def test_has_the_figures_that_later_checks_ask_for(figures):
    """Oracle: the names agreed on; every figure is a positive number."""
    loop = figures["closed_loop"]
    assert positive(figures["plant_alone"]["real_time_factor"])
    assert positive(loop["real_time_factor"])
    assert positive(loop["ratio_to_plant_alone"])
    assert set(figures["blocks"]) >= BLOCKS
    for block in figures["blocks"].values():
        assert positive(block["median_us"])
        assert block["p99_us"] >= block["median_us"]


def positive(number):
    return math.isfinite(number) and number > 0.0


def test_the_parts_are_faster_than_the_whole(figures):
    """Oracle: the controller contains its blocks, the loop the plant."""
    medians = {
        name: block["median_us"] for name, block in figures["blocks"].items()
    }
    whole = medians.pop("balance_controller")
    assert max(medians.values()) < whole
    plant, loop = figures["plant_alone"], figures["closed_loop"]
    assert plant["real_time_factor"] > loop["real_time_factor"]


def test_the_table_has_every_block(figures):
    lines = benchmark.as_text(figures).splitlines()
    assert len(lines) == 3 + len(figures["blocks"])
    for name in figures["blocks"]:
        assert sum(line.split()[0] == name for line in lines) == 1


def test_help_tells_the_exit_codes_and_the_defaults(capsys):
    outcome = run_script(benchmark, ["--help"], capsys)
    text = " ".join(" ".join(outcome.out).split())
    assert text.endswith("Exit code: 0 done, 2 bad input.")
    for default in ("walk_in_place", "as in the scenario", "5"):
        assert f"(default: {default})" in text


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--seconds", 0], "seconds = 0.0: must be > 0"),
        (["--seconds", -1], "seconds = -1.0: must be > 0"),
        (["--seconds", "nan"], "argument --seconds: 'nan': must be a finite"),
        (["--seconds", "x"], "argument --seconds: 'x': must be a finite"),
        (["--scenario_name", "x"], "scenario_name = 'x': must be one of push,"),
        (["--scenario_text", "{duration: -1}"], "duration = -1.0: must be"),
        (["--mechanisms", "x"], "mechanisms = 'x': must be one of icp_only,"),
        (["--nonsense"], "unrecognized arguments: --nonsense"),
    ],
)
def test_refuses_what_has_no_meaning(argv, message, capsys):
    outcome = run_script(benchmark, argv, capsys)
    assert_refused(outcome, message)
    assert outcome.out == []
