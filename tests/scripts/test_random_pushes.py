"""Pushes at random: which they are, and the page of those that fail."""

import contextlib
import re

import numpy as np
import pytest

from nadia_balance.core.walking.push import Moment
from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.scripts import random_pushes
from nadia_balance.scripts.sweep import Rows
from nadia_balance.scripts.sweep.limits import known_limits
from tests.scripts.running import assert_refused, run_script
from tests.scripts.sweep.made_up import MadeUpRobot, push_scenario
from tests.source_files import ROOT

FIG10 = ROOT / "docs" / "results" / "fig10"


def test_draws_a_share_of_the_limit_of_each_direction():
    """Oracle: by hand, between two limits; a left swing is mirrored."""
    known = {c: 1.0 + c.direction_deg / 360.0 for c in known_limits(FIG10)}
    pushes = random_pushes.drawn(push_scenario(), known, 300, 0.5)
    assert len(pushes) == 300
    for cell, push in pushes.items():
        moment = Moment.parse(cell.at)
        assert 0.05 <= push.duration <= 0.4
        seen = cell.direction_deg
        if moment.swing is Side.LEFT:
            seen = 360.0 - seen
        if seen < 330.0:  # beyond, the curve goes back to that of 0
            expected = 0.5 + seen / 720.0
            assert push.delta_v == pytest.approx(expected, abs=1e-3)
    moments = [Moment.parse(cell.at) for cell in pushes]
    swings = np.mean([moment.phase.value == "swing" for moment in moments])
    assert swings == pytest.approx(0.7, abs=0.1)
    bodies = {push.body for push in pushes.values()}
    assert bodies == {"PELVIS_LINK", "TORSO_LINK"}


@pytest.fixture
def made_up(monkeypatch):
    """A robot whose limit is 0.5 m/s, in every direction."""
    robot = MadeUpRobot()
    largest = "tests.scripts.sweep.made_up.largest"
    monkeypatch.setattr(largest, lambda *_: 0.5)
    opened = contextlib.nullcontext(robot)
    trial = random_pushes.envelope.trial
    monkeypatch.setattr(trial, "open_workers", lambda *_: opened)
    monkeypatch.setattr(trial, "run_trial", robot.trial)
    return robot


def test_every_failure_is_a_line_of_the_page(made_up, tmp_path, capsys):
    """Oracle: the rows; none is tried again."""
    argv = ["--pushes", 20, "--limits", FIG10, "--out", tmp_path]
    for _ in range(2):
        assert run_script(random_pushes, argv, capsys).code == 0
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
    refused = run_script(random_pushes, [*argv, "--share", 0], capsys)
    assert_refused(refused, "pushes = 1000, share = 0.0: must be in ")
