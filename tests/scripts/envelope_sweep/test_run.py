"""A sweep makes each of its trials once, whatever happens meanwhile."""

import pytest
from distributed import KilledWorker

from nadia_balance.scripts.envelope_sweep.rows import opened, read
from nadia_balance.scripts.envelope_sweep.run import run_sweep
from tests.scripts.envelope_sweep import made_up


def run(sweep, folder, robot=None, **more):
    """Runs the sweep on a made-up robot; returns its rows, and if all."""
    robot = robot or made_up.MadeUpRobot()
    with opened(folder, made_up.identity_of()) as rows:
        done = run_sweep(sweep, rows, robot, robot.slots, **more)
    return list(map(made_up.facts, read(folder).all)), done


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The rows of a sweep that nobody disturbed."""
    rows, done = run(made_up.made_up_sweep(), tmp_path_factory.mktemp("whole"))
    assert done
    return rows


@pytest.mark.parametrize("slots", [1, 7])
def test_the_rows_do_not_depend_on_how_many_work(tmp_path, slots, whole):
    robot = made_up.MadeUpRobot(slots)
    assert run(made_up.made_up_sweep(), tmp_path, robot) == (whole, True)
    assert len(robot.tried) == len(set(robot.tried)) == len(whole)


def test_goes_on_where_it_was_stopped(tmp_path, whole):
    """Oracle: the rows of the sweep that nobody stopped."""
    sweep, done, rows = made_up.made_up_sweep(), False, []
    while not done:
        asked = iter(range(4))
        before = len(rows)
        rows, done = run(
            sweep, tmp_path, stopped=lambda asked=asked: next(asked, 9) > 2
        )
        assert done or len(rows) > before
    assert rows == whole
    robot = made_up.MadeUpRobot()
    run(sweep, tmp_path, robot)
    assert robot.tried == []


def test_ends_when_the_workers_fail(tmp_path):
    """No row is made up for what was not tried: it can go on later."""

    def spoil(scenario):
        if scenario.mechanisms == "step":
            raise OSError("full")

    sweep = made_up.made_up_sweep()
    with pytest.raises(RuntimeError, match="a worker failed: OSError: full"):
        run(sweep, tmp_path, made_up.MadeUpRobot(spoil=spoil))
    assert {r["mechanisms"] for r in read(tmp_path).all} <= {"icp_only"}
    assert run(sweep, tmp_path)[1]


def test_a_trial_that_kills_its_process_has_a_row_that_says_so(tmp_path, whole):
    """Oracle: all other cells are those of a sweep in which none died."""

    def spoil(scenario):
        if scenario.mechanisms == "step" and scenario.seed == 0:
            raise KilledWorker("a trial", None, None)

    rows, done = run(
        made_up.made_up_sweep(), tmp_path, made_up.MadeUpRobot(spoil=spoil)
    )
    assert done
    crashed = [row for row in rows if row["outcome"] == "crashed"]
    assert {row["mechanisms"] for row in crashed} == {"step"}
    others = [row for row in rows if row["mechanisms"] == "icp_only"]
    assert others == [r for r in whole if r["mechanisms"] == "icp_only"]
