"""Each figure of the summary, against the recipe of a made-up run."""

import json
import math

import numpy as np
import pytest

from nadia_balance.core.walking import Phase
from nadia_balance.results.log import signal
from nadia_balance.results.summary import durations, stance_slip
from tests.results.made_up_run import (
    OMEGA,
    cut,
    make_log,
    summary_of,
    without_robot,
)


@pytest.fixture
def log():
    return make_log()


def test_is_strict_json_and_repeats_what_it_was_told(log):
    """Oracles: JSON, which takes neither NaN nor infinity; the recipe.

    Of six steps, five landed after the push, each 4 mm from its target.
    """
    log["mechanisms"] = np.zeros((len(log["t"]), 4))
    log["mechanisms"][500:, [0, 1]] = 1.0
    told = {"direction_deg": 90.0, "delta_v": 0.6, "seed": 3}
    cpu_time = float(log["t"][-1]) / 2.5
    summary = summary_of(log, cpu_time=cpu_time, **told)
    assert {name: summary[name] for name in told} == told
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert (summary["recovered"], summary["reason"]) == (True, "")
    (switch,) = summary["switched_mechanisms"]
    assert switch == {"time_s": 1.0, "on": ["step", "swing"]}
    (push,) = summary["pushes"]
    assert push == pytest.approx({"time_s": 1.976, "delta_v": 0.6})
    assert (summary["steps_taken"], summary["steps_after_push"]) == (6, 5)
    assert summary["footstep_error_m"] == pytest.approx(0.004)
    assert summary["real_time_factor"] == pytest.approx(2.5)


def test_durations_are_those_of_the_recipe(log):
    """Oracle: the recipe, with steps 2 and 3 hurried."""
    swings = [0.7, 0.43, 0.5, 0.7, 0.7, 0.7]
    assert durations(log, Phase.SWING) == pytest.approx(swings)
    transfers = [0.3, 0.3, 0.04, 0.3, 0.3, 0.3, 0.8]
    assert durations(log, Phase.TRANSFER) == pytest.approx(transfers)


def test_icp_error_figures(log):
    """Oracle: the push adds dv / omega, less what dies out in 0.1 s.

    de/dt = dv / (0.1 omega) - 2 omega e from e = 0, for 0.1 s; T is so small
    that the discrete recursion differs by less than 1 %.
    """
    decay = 2.0 * OMEGA
    largest = 0.6 / (0.1 * OMEGA * decay) * (1.0 - math.exp(-0.1 * decay))
    summary = summary_of(log)
    assert summary["max_icp_error_m"] == pytest.approx(largest, rel=0.01)
    squares = (log["icp"] - log["icp_reference"][:, :2]) ** 2
    rms = math.sqrt(squares.sum() / len(squares))
    assert summary["rms_icp_error_m"] == pytest.approx(rms)


def test_effort_is_relative_to_the_limits(log):
    """Oracle: one joint set by hand to 0.9 of its limit, and -7 rad/s."""
    log["actuation"][100, 3] = -0.9 * log["effort_limits"][3]
    log["state"][200, -1] = -7.0
    log["state"][:, 0] = 50.0  # a position is not a speed
    first_speed = int(log["num_positions"])
    log["state"][:, first_speed + 2] = 50.0  # nor is the floating base
    summary = summary_of(log)
    assert summary["max_torque_ratio"] == pytest.approx(0.9)
    assert summary["max_joint_speed"] == pytest.approx(7.0)
    assert summary["max_joint_speed_limit"] == 20.0
    assert summary["recovered"]


def test_slip_is_the_stance_foots_way_during_its_step(log):
    """Oracle: the left foot slides by 3 mm while the right one swings."""
    feet = signal(log, "foot_poses")
    feet[:] = 0.0
    swing = (log["t"] >= 0.8) & (log["t"] < 1.5)
    feet.left_x[swing] = np.linspace(0.0, 0.003, swing.sum())
    feet.right_x[swing] = np.linspace(0.0, 0.4, swing.sum())
    feet.left_z[swing] = 0.1  # height is no slip
    assert stance_slip(log) == pytest.approx(0.003)


def test_sums_up_both_qps(log):
    """Oracle: two failures, three fallbacks and a violation put in by hand."""
    momentum = signal(log, "momentum_qp_status")
    whole = signal(log, "whole_body_qp_status")
    whole.solved[[10, 20]] = 0.0
    whole.failures[10:] += 1
    whole.failures[20:] += 1
    whole.violation[10] = np.nan  # a failed solve has none
    momentum.fallback[[1, 2, 3]] = 1.0
    momentum.violation[5] = 4e-5
    summary = summary_of(log)
    assert summary["qp_solves"] == 2 * len(log["t"])
    assert summary["qp_failures"] == 2
    assert summary["qp_fallbacks"] == 3
    assert summary["max_qp_violation"] == 4e-5


SHORT = "the run is too short for 8 more steps, {} were required"


@pytest.mark.parametrize(
    ("told", "reason"),
    [
        ({"error": "icp: NaN", "missed_pushes": 1}, "stopped: icp: NaN"),
        ({"fell_at": 2.0, "fall_reason": "low"}, "fell: low"),
        ({"interrupted": True}, "interrupted"),
        # What was not pushed took no steps after it either.
        ({"missed_pushes": 1, "required_steps": 8}, "not pushed: the push"),
        ({"improper_contacts": ("A - ground",)}, "contact of A"),
        (
            {"required_steps": 6, "wanted_steps": 8},
            f"fewer than 6 steps after the push, {SHORT.format(6)}",
        ),
    ],
)
def test_says_why_a_run_does_not_count_as_recovered(log, told, reason):
    summary = summary_of(log, **told)
    assert summary["recovered"] is False
    assert summary["reason"].startswith(reason)


def test_says_that_a_run_is_too_short_to_ask_for_more(log):
    """Oracle: five steps after the push; a reservation is no failure."""
    summary = summary_of(log, required_steps=5, wanted_steps=8)
    assert (summary["recovered"], summary["reason"]) == (True, SHORT.format(5))


@pytest.mark.parametrize(
    ("name", "rows", "value", "reason"),
    [
        ("state", 200, -20.0, ""),
        ("state", 200, -20.01, "too fast: a joint at 20.01 rad/s, limit 20"),
        ("state", 200, np.nan, "too fast: a joint at nan rad/s, limit 20"),
        ("actuation", 200, 300.0, ""),
        ("actuation", 200, -301.0, "a torque was above its limit"),
        ("actuation", 200, np.nan, "a torque was above its limit"),
        ("icp", slice(-50, None), 0.6, "the ICP error did not stay below 0.05"),
        ("icp", -1, np.nan, "the ICP error did not stay below 0.05 m"),
    ],
)
def test_a_limit_may_be_reached_and_not_passed(log, name, rows, value, reason):
    log[name][rows, -2] = value
    summary = summary_of(log)
    assert summary["recovered"] is not bool(reason)
    assert summary["reason"].startswith(reason)


def test_a_point_mass_has_no_joints_but_all_other_figures(log):
    summary = summary_of(without_robot(log), plant="lipm")
    assert summary["recovered"] is True
    missing = {name for name, value in summary.items() if value is None}
    of_joints = "max_torque_ratio max_joint_speed max_joint_speed_limit"
    assert missing >= {*of_joints.split(), "stance_slip_m"}
    assert summary["qp_solves"] == len(log["t"])


@pytest.mark.parametrize("rows", [0, 1])
def test_an_interrupted_run_may_have_logged_next_to_nothing(log, rows):
    summary = summary_of(cut(log, rows), interrupted=True)
    assert summary["recovered"] is False
    assert summary["duration_s"] == 0.0
    json.dumps(summary, allow_nan=False)
