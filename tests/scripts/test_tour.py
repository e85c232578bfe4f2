"""The command line of the tour; its runs are in sweep/test_tours.py."""

from unittest.mock import patch

import pytest

from nadia_balance.scripts import tour
from tests.scripts.running import assert_refused, run_script


def test_flags_are_those_of_the_sweep(capsys):
    """Oracle: by hand."""
    with patch.object(tour.envelope, "carry_out") as carry_out:
        carry_out.return_value = 0
        argv = "--stages", "held,punched", "--seeds", 3, "--engine", "mujoco"
        assert run_script(tour, argv, capsys).code == 0
    sweep = carry_out.call_args.kwargs["sweep"]
    assert [*map(tuple, sweep.cells())] == [
        (stage, seed) for seed in range(3) for stage in ("held", "punched")
    ]
    assert (sweep.scenario.robot, sweep.scenario.engine) == ("g1", "mujoco")


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (("--stages", "thrown"), "stages = 'thrown': must be of held, walked"),
        (("--stages", ","), "stages = ',': must name at least one"),
        (("--seeds", 0), "seeds = 0: must be in [1, 512]"),
        (("--scenario_text", "{fidelity: ideal}"), "fidelity = 'ideal': must"),
        (("--scenario_text", "{robot: g1}"), "scenario_text has robot: must "),
    ],
)
def test_bad_input_is_one_line(argv, message, capsys, tmp_path):
    argv = *argv, "--out", tmp_path
    assert_refused(run_script(tour, argv, capsys), message)
