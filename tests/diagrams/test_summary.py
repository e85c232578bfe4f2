"""Each figure of the summary, against the recipe of a made-up run."""

import json
import math

import numpy as np
import pytest

from diagrams.run_log import FAILURES, FALLBACK, SOLVED, VIOLATION
from diagrams.summary import (
    RunInfo,
    durations,
    stance_slip,
    steps_after_push,
    summarize,
)
from nadia_balance.core.walking import Phase
from tests.diagrams.made_up_run import (
    MASS,
    OMEGA,
    Recipe,
    T,
    cut,
    make_log,
    without_robot,
)

INFO = {"robot": "nadia", "mechanisms": "icp_only"}
KEYS = """recovered fell_at robot mechanisms direction_deg delta_v
max_icp_error_m rms_icp_error_m footstep_error_m swing_durations_s
transfer_durations_s steps_taken max_torque_ratio max_joint_speed qp_solves
qp_failures qp_fallbacks max_qp_violation real_time_factor stance_slip_m
non_foot_contact improper_contacts versions max_joint_speed_limit
required_steps missed_pushes switched_mechanisms""".split()


@pytest.fixture(scope="module")
def log():
    return make_log(Recipe())


def summary_of(log, **info):
    return summarize(log, RunInfo(**INFO, **info))


def test_has_all_the_figures_that_are_asked_for(log):
    """Oracle: the list of the issue; and JSON takes it strictly."""
    summary = summary_of(log)
    assert set(KEYS) <= set(summary)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


def test_repeats_what_it_was_told(log):
    told = {"direction_deg": 90.0, "delta_v": 0.6, "seed": 3}
    summary = summary_of(log, **told)
    assert {name: summary[name] for name in told} == told


def test_says_what_was_switched_in_the_tab(log):
    """Oracle: the rows in which the made-up signal changes."""
    assert summary_of(log)["switched_mechanisms"] == []
    on = np.zeros((len(log["t"]), 4))
    on[500:, [0, 1]] = 1.0
    on[900:, 1] = 0.0
    found = summary_of({**log, "mechanisms": on})["switched_mechanisms"]
    assert [entry["on"] for entry in found] == [["step", "swing"], ["step"]]
    assert [entry["time_s"] for entry in found] == pytest.approx([1.0, 1.8])


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


def test_footstep_error_is_from_the_adjusted_target():
    log = make_log(Recipe(miss=0.013))
    assert summary_of(log)["footstep_error_m"] == pytest.approx(0.013)


def test_counts_steps_in_all_and_after_the_push(log):
    """Oracle: 6 steps; the push is in the second one's swing."""
    assert summary_of(log)["steps_taken"] == 6
    assert steps_after_push(log) == 5


def test_effort_is_relative_to_the_limits(log):
    """Oracle: one joint set by hand to 0.9 of its limit, and -7 rad/s."""
    changed = {name: array.copy() for name, array in log.items()}
    changed["actuation"][100, 3] = -0.9 * log["effort_limits"][3]
    changed["state"][200, -1] = -7.0
    changed["state"][:, 0] = 50.0  # a position is not a speed
    first_speed = int(log["num_positions"])
    changed["state"][:, first_speed + 2] = 50.0  # nor is the floating base
    summary = summary_of(changed)
    assert summary["max_torque_ratio"] == pytest.approx(0.9)
    assert summary["max_joint_speed"] == pytest.approx(7.0)
    assert summary["max_joint_speed_limit"] == 20.0
    assert summary["recovered"]


def test_slip_is_the_stance_foots_way_during_its_step(log):
    """Oracle: the left foot slides by 3 mm while the right one swings."""
    n = len(log["t"])
    feet = np.zeros((n, 6))
    swing = (log["t"] >= 0.8) & (log["t"] < 1.5)
    feet[swing, 0] = np.linspace(0.0, 0.003, swing.sum())
    feet[swing, 3] = np.linspace(0.0, 0.4, swing.sum())  # the foot in the air
    feet[swing, 2] = 0.1  # height is no slip
    assert stance_slip({**log, "foot_poses": feet}) == pytest.approx(0.003)


def test_slip_of_one_who_only_stands_is_that_of_either_foot():
    log = cut(make_log(), 200)
    feet = np.zeros((200, 6))
    feet[100:, 4] = 0.002
    assert stance_slip({**log, "foot_poses": feet}) == pytest.approx(0.002)


def test_sums_up_both_qps(log):
    """Oracle: two failures, three fallbacks and a violation put in by hand."""
    momentum = log["momentum_qp_status"].copy()
    body = log["whole_body_qp_status"].copy()
    body[[10, 20], SOLVED] = 0.0
    body[10:, FAILURES] += 1
    body[20:, FAILURES] += 1
    body[10, VIOLATION] = np.nan  # a failed solve has none
    momentum[[1, 2, 3], FALLBACK] = 1.0
    momentum[5, VIOLATION] = 4e-5
    status = {"momentum_qp_status": momentum, "whole_body_qp_status": body}
    summary = summary_of({**log, **status})
    assert summary["qp_solves"] == 2 * len(log["t"])
    assert summary["qp_failures"] == 2
    assert summary["qp_fallbacks"] == 3
    assert summary["max_qp_violation"] == 4e-5


def test_real_time_factor_is_simulated_per_cpu_second(log):
    seconds = T * len(log["t"])
    summary = summary_of(log, cpu_time=seconds / 2.5)
    assert summary["real_time_factor"] == pytest.approx(2.5)
    assert summary_of(log)["real_time_factor"] is None


def test_recovered_if_nothing_speaks_against_it(log):
    summary = summary_of(log)
    assert summary["recovered"] is True
    assert summary["reason"] == ""


def icp_error_at_the_end(log):
    icp = log["icp"].copy()
    icp[-50:, 0] += 0.06
    return {**log, "icp": icp}


def torque_above_its_limit(log):
    return {**log, "actuation": 3.0 * log["actuation"]}


def torque_unknown(log):
    actuation = log["actuation"].copy()
    actuation[100, 2] = np.nan
    return {**log, "actuation": actuation}


def joint_at(speed):
    def change(log):
        state = log["state"].copy()
        state[200, -2] = -speed
        return {**log, "state": state}

    return change


def unknown_icp_at_the_end(log):
    icp = log["icp"].copy()
    icp[-1] = np.nan
    return {**log, "icp": icp}


@pytest.mark.parametrize(
    ("change", "info", "reason"),
    [
        (dict, {"error": "icp: NaN", "missed_pushes": 1}, "stopped: icp: NaN"),
        (dict, {"fell_at": 2.0, "fall_reason": "low"}, "fell: low"),
        (dict, {"interrupted": True}, "interrupted"),
        (dict, {"missed_pushes": 1}, "not pushed: the push did not come"),
        # Who was not pushed took no steps after it either.
        (dict, {"missed_pushes": 1, "required_steps": 8}, "not pushed: "),
        (dict, {"improper_contacts": ("A - ground",)}, "contact of A"),
        (dict, {"required_steps": 8}, "fewer than 8 steps"),
        (dict, {"required_steps": 6}, "fewer than 6 steps"),
        (
            dict,
            {"required_steps": 6, "wanted_steps": 8},
            "fewer than 6 steps after the push, the run is too short for 8 "
            "more steps, 6 were required",
        ),
        (joint_at(20.01), {}, "too fast: a joint at 20.01 rad/s, limit 20"),
        (joint_at(31.26), {}, "too fast: a joint at 31.26 rad/s, limit 20"),
        (joint_at(np.nan), {}, "too fast: a joint at nan rad/s, limit 20 rad"),
        (torque_unknown, {}, "above its limit"),
        (icp_error_at_the_end, {}, "ICP error"),
        (unknown_icp_at_the_end, {}, "ICP error"),
        (torque_above_its_limit, {}, "above its limit"),
    ],
)
def test_says_why_a_run_does_not_count_as_recovered(log, change, info, reason):
    summary = summary_of(change(log), **info)
    assert summary["recovered"] is False
    assert reason in summary["reason"]


def test_a_joint_at_its_limit_is_within_it(log):
    summary = summary_of(joint_at(20.0)(log))
    assert summary["recovered"] is True
    assert summary["max_joint_speed"] == 20.0


def test_an_older_log_knows_no_limit_of_the_joints(log):
    """Oracle: nothing to judge by, and nothing invented."""
    old = {k: v for k, v in log.items() if k != "joint_speed_limit"}
    summary = summary_of(joint_at(31.0)(old))
    assert summary["recovered"] is True
    assert summary["max_joint_speed_limit"] is None


def test_recovers_with_the_steps_that_are_required(log):
    """Oracle: the recipe has five after the push."""
    summary = summary_of(log, required_steps=5, wanted_steps=5)
    assert (summary["recovered"], summary["reason"]) == (True, "")
    assert summary["required_steps"] == 5


def test_says_that_a_run_is_too_short_to_ask_for_more(log):
    """Oracle: the sentence; it is a reservation and no failure."""
    summary = summary_of(log, required_steps=3, wanted_steps=8)
    assert summary["recovered"] is True
    assert summary["reason"] == (
        "the run is too short for 8 more steps, 3 were required"
    )


def test_a_point_mass_has_no_joints_but_all_other_figures(log):
    summary = summary_of(without_robot(log), plant="lipm")
    assert summary["recovered"] is True
    missing = {name for name in KEYS if summary[name] is None}
    assert missing >= {"max_torque_ratio", "max_joint_speed", "stance_slip_m"}
    assert "max_joint_speed_limit" in missing
    assert summary["qp_solves"] == len(log["t"])
    assert summary["max_icp_error_m"] > 0.1


@pytest.mark.parametrize("rows", [0, 1])
def test_an_interrupted_run_may_have_logged_next_to_nothing(log, rows):
    summary = summary_of(cut(log, rows), interrupted=True)
    assert summary["recovered"] is False
    assert summary["duration_s"] == 0.0
    json.dumps(summary, allow_nan=False)


def test_the_push_of_the_recipe_is_what_it_says(log):
    """Oracle: momentum of the logged force, over the mass."""
    momentum = np.sum(log["push_force"], axis=0) * T
    assert momentum / MASS == pytest.approx([0.0, 0.6, 0.0])
