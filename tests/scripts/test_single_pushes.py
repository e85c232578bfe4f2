"""Single pushes: which they are, and the page of those that fail."""

import contextlib
import re
from unittest.mock import patch

import numpy as np
import pytest

from nadia_balance.core.walking.push import Moment
from nadia_balance.core.walking.state import Side
from nadia_balance.scripts import single_pushes
from nadia_balance.sweep.limits import PROTOCOLS
from nadia_balance.sweep.trials import Rows
from tests.scripts.running import assert_refused, run_script
from tests.source_files import ROOT
from tests.sweep.made_up import MadeUpRobot

FIG10 = ROOT / "docs" / "results" / "fig10"


def sweep_of(capsys, *argv, grow=True) -> single_pushes.SinglePushes:
    """The sweep of the flags; its limits `grow` with the direction."""
    with patch.object(single_pushes.envelope, "carry_out") as carry_out:
        carry_out.return_value = 0
        argv = ["--limits", FIG10, *argv]
        assert run_script(single_pushes, argv, capsys).code == 0
    sweep = carry_out.call_args.kwargs["sweep"]
    for cell in sweep.known_limits if grow else ():
        sweep.known_limits[cell] = 1.0 + cell.direction_deg / 360.0
    return sweep


def test_a_push_is_a_share_of_the_limit_of_its_direction(capsys):
    """Oracle: by hand, between two limits; a left swing is mirrored."""
    sweep = sweep_of(capsys, "--share", 0.5, "--pushes", 300)
    cells = sweep.cells()
    assert len(cells) == 300
    for cell in cells:
        moment = Moment.parse(cell.at)
        seen = cell.direction_deg
        if moment.swing is Side.LEFT:
            seen = 360.0 - seen
        if seen < 330.0:  # beyond, the curve goes back to that of 0
            expected = 0.5 + seen / 720.0
            ((delta_v, replica),) = sweep.attempts(cell, {})
            assert (delta_v, replica) == (pytest.approx(expected, abs=1e-3), 0)
        assert 0.05 <= sweep.walk(cell, 0).pushes[0].duration <= 0.4
    moments = [Moment.parse(cell.at) for cell in cells]
    swings = np.mean([moment.phase.value == "swing" for moment in moments])
    assert swings == pytest.approx(0.7, abs=0.1)
    bodies = {sweep.walk(cell, 0).pushes[0].body for cell in cells}
    assert bodies == {"PELVIS_LINK", "TORSO_LINK"}


def test_limits_of_a_left_moment_are_not_mirrored_for_it(capsys):
    """Oracle: the limits, which grow; there is none of a transfer."""
    at = "left swing 25 %,left transfer 50 %,right swing 50 %"
    sweep = sweep_of(capsys, "--directions", "90,", "--at", at)
    limits = {
        cell._replace(at=cell.at.replace("right", "left")): limit
        for cell, limit in sweep.known_limits.items()
    }
    sweep.known_limits = limits
    found = [sweep.attempts(cell, {})[0][0] for cell in sweep.cells()]
    assert found == pytest.approx([0.6 * x for x in (1.25, 1.25, 1.75)])


def test_a_push_at_random_lasts_some_ticks_of_the_plant(capsys):
    """Oracle: the periods, 4 ms of the body and 10 ms of the point mass."""
    for plant, period in ("humanoid", 0.004), ("lipm", 0.01):
        sweep = sweep_of(capsys, "--pushes", 20, "--plant", plant)
        ticks = [push.duration / period for push in sweep.drawn.values()]
        np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-6)


def test_pushes_come_where_they_are_asked_for(capsys):
    """Oracle: by hand; body and length are the scenario's."""
    at = "left transfer 50 %", "right swing 10 %"
    argv = "--directions", "45,300", "--at", ",".join(at), "--engine", "mujoco"
    sweep = sweep_of(capsys, *argv, "--mechanisms", "step")
    asked = [(*cell[1:3], cell.direction_deg) for cell in sweep.cells()]
    assert asked == [(a, "step", d) for a in at for d in (45.0, 300.0)]
    sizes = [sweep.attempts(cell, {})[0][0] for cell in sweep.cells()]
    # The next swing of a left transfer is the left one.
    seen = 315.0, 60.0, 45.0, 300.0
    expected = [0.6 * (1.0 + angle / 360.0) for angle in seen]
    assert sizes == pytest.approx(expected, abs=1e-3)
    walk = sweep.walk(sweep.cells()[0], 0)
    assert (walk.engine, walk.pushes[0].duration) == ("mujoco", 0.1)


def test_a_papers_pushes_are_all_of_its_figure(capsys):
    """Oracle: Fig. 6 by hand, in shares of the weight, for 0.1 s."""
    argv = "--limits", "atlas_fig6", "--share", 0.5
    sweep = sweep_of(capsys, *argv, grow=False)
    assert sweep.mechanisms == ("feedback_step_timing",)
    sizes = {c[::3]: sweep.attempts(c, {})[0][0] for c in sweep.cells()}
    assert len(sizes) == 4 * 14
    for gait, force in ("forward_fast", 1.60), ("forward_slow", 0.96):
        found = sizes[f"atlas_{gait}", 0.0]
        assert found == pytest.approx(0.5 * force * 9.81 * 0.1, abs=5e-4)


def test_a_number_of_pushes_counts_for_a_papers_figure_too(capsys):
    """Oracle: Fig. 6 by hand: forces up to 1.6 of the weight, for 0.1 s."""
    argv = "--limits", "atlas_fig6", "--pushes", 6
    sweep = sweep_of(capsys, *argv, grow=False)
    cells = sweep.cells()
    gaits = {cell.scenario for cell in cells}
    assert len(cells) == 6 and gaits == {*sweep.scenarios} and len(gaits) == 4
    for cell in cells:
        ((delta_v, _),) = sweep.attempts(cell, {})
        assert 0.0 < delta_v <= 0.6 * 1.6 * 0.981
        assert 0.05 <= sweep.walk(cell, 0).pushes[0].duration <= 0.4


def test_without_a_checkout_the_limits_are_the_papers(tmp_path, monkeypatch):
    """Oracle: in the package are the papers' figures, and no results."""
    assert single_pushes.default_limits() == FIG10
    default = single_pushes.default_limits(tmp_path)
    assert str(default) in PROTOCOLS
    monkeypatch.setattr(single_pushes, "default_limits", lambda: default)
    monkeypatch.chdir(tmp_path)
    with patch.object(single_pushes.envelope, "carry_out") as carry_out:
        single_pushes.main(["--pushes", "3"])
    sweep = carry_out.call_args.kwargs["sweep"]
    assert len(sweep.cells()) == 3
    assert sweep.known_limits == PROTOCOLS["nadia_fig10"].largest(
        "all_with_cross_over"
    )


@pytest.fixture
def made_up(monkeypatch):
    """A robot whose limit is 0.5 m/s, in every direction."""
    robot = MadeUpRobot()
    largest = "tests.sweep.made_up.largest"
    monkeypatch.setattr(largest, lambda *_: 0.5)
    opened = contextlib.nullcontext(robot)
    run_trial = single_pushes.envelope.run_trial
    monkeypatch.setattr(run_trial, "open_workers", lambda *_: opened)
    monkeypatch.setattr(run_trial, "run_trial", robot.trial)
    return robot


def test_every_failure_is_a_line_of_the_page(made_up, tmp_path, capsys):
    """Oracle: the rows; none is tried again."""
    argv = ["--pushes", 20, "--limits", FIG10, "--out", tmp_path]
    for _ in range(2):
        assert run_script(single_pushes, argv, capsys).code == 0
    rows = Rows.read(tmp_path).all
    assert len(made_up.tried) == len(rows) == 20
    bad = [row for row in rows if row["outcome"] != "recovered"]
    failed = {row["direction_deg"] for row in bad}
    assert 0 < len(failed) < 20
    page = (tmp_path / "failures.md").read_text("utf-8")
    lines = re.findall(r'^\|[^|]*\| +([\d.]+) \|.*"ouch"', page, re.MULTILINE)
    assert {float(direction) for direction in lines} == failed


def test_refuses_what_has_no_meaning(tmp_path, capsys):
    argv = ["--limits", FIG10, "--out", tmp_path]
    refused = run_script(single_pushes, [*argv, "--share", 0], capsys)
    assert_refused(refused, "share = 0.0: must be in (0, 3]")
    for more in (["--directions", "0,90"], ["--at", "right swing 50 %"]):
        argv_more = [*argv, "--pushes", 3, *more]
        refused = run_script(single_pushes, argv_more, capsys)
        assert_refused(refused, "pushes = 3: must not come with directions or ")
    for name, message in (
        (
            "atlas_in_place_slow",
            f"limits = '{FIG10}': must be of atlas, not of",
        ),
        ("push_standing", "limits: must have some of push_standing"),
    ):
        of_another = [*argv, "--scenario_name", name]
        refused = run_script(single_pushes, of_another, capsys)
        assert_refused(refused, message)
