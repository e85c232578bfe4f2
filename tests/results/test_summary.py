"""Each figure of the summary, against the recipe of a made-up run."""

import json
import math

import numpy as np
import pytest
from shapely import Polygon
from shapely.affinity import rotate, translate

from nadia_balance.results.film import film
from nadia_balance.results.log import signal_view
from nadia_balance.results.measurements import StandsWatch
from tests.results.made_up_run import MASS, Recipe, T, cut, make_log, summary_of

RESTLESS = "the ICP error did not stay below 0.05 m"
SHORT = {"calm_steps": 2}
MISSED = {"missed_pushes": 1, "calm_steps": 2}


@pytest.fixture
def log():
    return make_log()


def test_is_strict_json_and_repeats_what_it_was_told(log):
    """Oracles: JSON, which takes neither NaN nor infinity; the recipe.

    Of six steps, five landed after the push, each 4 mm from its target.
    """
    conditions = {"direction_deg": 90.0, "delta_v": 0.6, "seed": 3}
    cpu_time = float(log["t"][-1]) / 2.5
    summary = summary_of(log, cpu_time=cpu_time, **conditions)
    assert {name: summary[name] for name in conditions} == conditions
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert (summary["recovered"], summary["reason"]) == (True, "")
    (push,) = summary["pushes"]
    assert (push["time_s"], push["delta_v"]) == pytest.approx((1.976, 0.6))
    assert (summary["steps_taken"], summary["steps_after_push"]) == (6, 5)
    assert summary["footstep_error_m"] == pytest.approx(0.004)
    swings = [0.7, 0.43, 0.5, 0.7, 0.7, 0.7]
    assert summary["swing_durations_s"] == pytest.approx(swings)
    assert summary["real_time_factor"] == pytest.approx(2.5)


def test_a_number_that_is_none_loses_no_file(log):
    """Oracle: JSON; the other numbers of the push, and of the strips."""
    log["actuation"][-1, 0] = log["torques"][-1, 0] = np.nan
    log["push_signal"][:, 2] = np.nan  # its force
    summary = summary_of(log)
    told = json.loads(
        json.dumps([summary, film(log, summary)], allow_nan=False)
    )
    assert told[0] == summary


def test_effort_is_relative_to_the_limits(log):
    """Oracle: one joint set by hand to 0.9 of its limit, and -7 rad/s."""
    log["foot_forces"][100, 1] = 3.5 * log["weight"]
    log["actuation"][100, 3] = -0.9 * log["effort_limits"][3]
    log["state"][200, -1] = -7.0
    log["joint_speed_limits"][-1] = 8.0
    log["state"][:, 0] = 50.0  # a position is not a speed
    first_joint = log["joint_speed_columns"][0]
    log["state"][:, first_joint - 6] = 50.0  # nor is the floating base
    summary = summary_of(log)
    assert summary["max_impact_body_weights"] == pytest.approx(3.5)
    assert summary["max_torque_ratio"] == pytest.approx(0.9)
    assert summary["max_joint_speed"] == pytest.approx(7.0)
    assert summary["max_joint_speed_ratio"] == pytest.approx(7.0 / 8.0)
    assert summary["recovered"]


def test_torque_steps_are_commanded_and_power_is_delivered(log):
    """Oracle: two joints set by hand, in an order that is not the state's."""
    log["actuation"][:] = log["torques"][:] = log["state"][:] = 0.0
    log["joint_speed_columns"] = log["joint_speed_columns"][::-1]
    log["actuation"][100:, 3] = -80.0
    log["torques"][200, [0, 1]] = 100.0, -30.0
    log["state"][200, [-1, -2]] = 5.0, 2.0
    summary = summary_of(log)
    assert summary["max_torque_step"] == 80.0
    assert summary["max_power_w"] == pytest.approx(500.0 - 60.0)
    assert summary["positive_power_w"] == pytest.approx(500.0)


def test_posture_is_that_of_trunk_and_centre_of_mass(log):
    """Oracle: set by hand; the ground is where the lower sole is."""
    log["trunk_tilt"][100] = np.radians([30.0, 12.0])
    log["trunk_tilt"][200] = np.radians([20.0, 15.0])
    com, feet = signal_view(log, "com_state"), signal_view(log, "foot_poses")
    com.z[:], feet.left_z[:], feet.right_z[:] = 1.95, 1.0, 1.1
    com.z[300], feet.right_z[300] = 1.85, 0.98
    summary = summary_of(log)
    assert summary["max_torso_tilt_deg"] == pytest.approx(30.0)
    assert summary["max_pelvis_tilt_deg"] == pytest.approx(15.0)
    assert summary["com_sag_m"] == pytest.approx(0.95 - (1.85 - 0.98))
    assert summary_of(log, max_torso_tilt_deg=30.1)["recovered"]
    reason = summary_of(log, max_torso_tilt_deg=29.9)["reason"]
    assert reason == "tilted: the torso by 30 deg"


@pytest.mark.parametrize(
    ("large_at", "calm"), [(2.5, 3), (2.76, 3), (2.78, 2), (3.8, 1), (5.0, 0)]
)
def test_calm_steps_are_whole_ones_with_small_errors(log, large_at, calm):
    """Oracle: by hand: it lands at 1.5, 2.23, 2.77, 3.77, 4.77 and 5.77 s.

    A walk that ends before it was calm for long enough is undecided, as it has
    taken four steps; one that stands at its end, well, has recovered.
    """
    log["icp"][:] = log["icp_reference"][:, :2]
    log["icp"][round(large_at / 0.002), 1] += 0.06
    walks = cut(log, round(5.9 / 0.002))
    assert summary_of(walks)["calm_steps"] == calm
    assert summary_of(walks, calm_steps=calm)["recovered"]
    more = summary_of(walks, calm_steps=calm + 1)
    reason = f"too short: {RESTLESS} for {calm + 1} whole steps"
    assert (more["outcome"], more["reason"]) == ("undecided", reason)
    assert summary_of(log, calm_steps=calm + 1)["recovered"]


@pytest.mark.parametrize(
    ("x", "yaw", "heading", "square"),
    [
        (0.09, 0.0, 0.0, True),
        (0.11, 0.0, 0.0, False),
        (0.0, math.radians(9.0), 2.0, True),
        (0.0, math.radians(11.0), 2.0, False),
        (-0.11, math.radians(-9.0), 3.1, False),
    ],
)
def test_a_robot_stands_again_when_its_feet_are_square(
    log, x, yaw, heading, square
):
    """Oracle: by hand: 10 cm, 10 deg; the right foot from the left one's."""
    walking = signal_view(log, "walking_signal")
    middle = heading + 0.5 * yaw
    walking.left[:] = np.array([[3.0], [-1.0], [heading]])
    offset = np.array([x * math.cos(middle), x * math.sin(middle)])
    offset += 0.3 * np.array([math.sin(middle), -math.cos(middle)])
    turned = math.remainder(heading + yaw, math.tau)
    walking.right[:] = np.array(
        [[3.0 + offset[0]], [-1.0 + offset[1]], [turned]]
    )
    summary = summary_of(log)
    expected = "" if square else "it stands, but its feet are not side by side"
    assert summary["reason"].removeprefix("too short: ") == expected
    watch = StandsWatch()
    now = signal_view(log, "walking_signal", -1)
    stood = [watch.update(t, now, 0.01, False) for t in (1.0, 1.2, 1.5)]
    assert stood == pytest.approx([0.0, 0.2, 0.5] if square else [0.0] * 3)
    assert watch.update(1.6, now, 0.06, False) == 0.0
    assert watch.update(1.7, now, 0.01, True) == 0.0


def test_eight_steps_are_enough_to_tell_that_it_did_not_recover():
    """Oracle: the recipe: 11 steps, of which nine landed after the push."""
    log = make_log(Recipe(num_steps=11))
    log["icp"][:] = log["icp_reference"][:, :2] + [0.06, 0.0]
    summary = summary_of(cut(log, round(9.9 / 0.002)), calm_steps=2)
    assert summary["steps_after_push"] >= 8
    assert summary["outcome"] == "failed"


def test_speed_of_the_swing_foot(log):
    """Oracle: a half circle of 0.2 m, in the first swing of 0.7 s."""
    feet = signal_view(log, "foot_poses")
    feet[:] = 0.0
    first = int(np.flatnonzero(log["t"] > 0.8 - 1e-9)[0])
    share = np.linspace(0.0, 1.0, 351)
    angle = np.pi * 0.5 * (1.0 - np.cos(np.pi * share))
    feet.right_x[first : first + 351] = 0.2 * (1.0 - np.cos(angle))
    feet.right_z[first : first + 351] = 0.2 * np.sin(angle)
    feet.right_x[first + 351 :] = 0.4
    speed = summary_of(log)["mean_swing_foot_speed"]
    assert speed == pytest.approx(np.pi * 0.2 / 0.7, rel=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_distance_of_the_soles_in_plan_view(log, seed):
    """Oracle: shapely; one foot far above the other does not pass it."""
    rng, feet = np.random.default_rng(seed), signal_view(log, "foot_poses")
    feet[:] = 0.0
    feet.right_y[:], feet.right_z[:] = -5.0, 0.2
    rows, least = rng.integers(len(log["t"]), size=6), math.inf
    for row in rows:
        soles = []
        for foot in np.split(log["foot_poses"][row], 2):
            foot[:2], foot[3] = rng.normal(size=2), rng.normal()
            sole = rotate(Polygon(log["sole"]), foot[3], (0, 0), True)
            soles.append(translate(sole, *foot[:2]))
        log["foot_poses"][row, [2, 6]] = 0.5, 0.401
        least = min(least, soles[0].distance(soles[1]))
    assert summary_of(log)["min_sole_distance_m"] == pytest.approx(least)
    log["foot_poses"][rows[0], [0, 4, 1, 5]] = 0.0
    assert summary_of(log)["min_sole_distance_m"] == 0.0


def test_slip_is_the_stance_foots_way_during_its_step(log):
    """Oracle: the left foot slides by 3 mm while the right one swings."""
    feet = signal_view(log, "foot_poses")
    feet[:] = 0.0
    swing = (log["t"] >= 0.8) & (log["t"] < 1.5)
    feet.left_x[swing] = np.linspace(0.0, 0.003, swing.sum())
    feet.right_x[swing] = np.linspace(0.0, 0.4, swing.sum())
    feet.left_z[swing] = 0.1  # height is no slip
    assert summary_of(log)["stance_slip_m"] == pytest.approx(0.003)


def test_sums_up_both_qps(log):
    """Oracle: two failures, three fallbacks and a violation put in by hand."""
    momentum = signal_view(log, "momentum_qp_status")
    whole = signal_view(log, "whole_body_qp_status")
    whole.solved[[10, 20]] = 0.0
    whole.failures[10:] += 1
    whole.failures[20:] += 1
    whole.violation[10] = np.nan  # a failed solve has none
    momentum.fallback[[1, 2, 3]] = 1.0
    momentum.violation[5] = 4e-5
    summary = summary_of(log)
    assert summary["qp_failures"] == 2
    assert summary["qp_fallbacks"] == 3
    assert summary["max_qp_violation"] == 4e-5


def test_one_that_waits_in_a_transfer_had_its_time(log):
    """Oracle: by hand: 5 s; it has taken two steps, and takes no third."""
    walks = cut(log, round(3.9 / 0.002))
    waits = {
        name: np.concatenate((rows, np.repeat(rows[-1:], 2600, axis=0)))
        if np.shape(rows)[:1] == walks["t"].shape
        else rows
        for name, rows in walks.items()
    }
    waits["t"] = 0.002 * np.arange(len(waits["t"]))
    assert summary_of(waits, **SHORT)["outcome"] == "undecided"
    signal_view(waits, "walking_signal").waiting[-2600:] = 1.0
    summary = summary_of(waits, **SHORT)
    assert summary["outcome"] == "failed"
    assert summary["reason"] == f"{RESTLESS} for 2 whole steps"


@pytest.mark.parametrize(
    ("rows", "conditions", "reason"),
    [
        # It lands at 2.77 and 3.77 s, after a push that ended at 2.076 s.
        (2000, SHORT, f"too short: {RESTLESS} for 2 whole steps"),
        # What was not pushed took no steps after it either.
        (900, MISSED, "not pushed: the push did not come before the end"),
        (1200, {}, "too short: the run ended 0.32 s after the push"),
    ],
)
def test_a_run_that_is_too_short_is_undecided(log, rows, conditions, reason):
    """Oracle: the recipe; a fall is a fall, nevertheless."""
    short = cut(log, rows)
    summary = summary_of(short, **conditions)
    assert (summary["outcome"], summary["recovered"]) == ("undecided", False)
    assert summary["reason"] == reason
    assert summary["recovery_time_s"] is None
    for failure, reason in (
        ({"error": "icp: NaN"}, "stopped: icp: NaN"),
        ({"interrupted": True}, "interrupted"),
        ({"improper_contacts": ("A - B", "A - ground")}, "contact of A - B, A"),
    ):
        summary = summary_of(short, **conditions, **failure)
        assert summary["outcome"] == "failed"
        assert summary["reason"].startswith(reason)
    assert summary["self_contacts"] == ["A - B"]


def test_a_push_is_told_in_newton_seconds_and_joules(log):
    """Oracles: m dv; work and energy of a free mass that was at rest."""
    com = signal_view(log, "com_state")
    first = int(np.flatnonzero(signal_view(log, "push_signal").number)[0])
    share = np.clip((np.arange(len(log["t"])) - first + 1) / 50, 0.0, 1.0)
    com.velocity[:] = 0.0
    com.vy[:] = 0.6 * share
    (push,) = summary_of(log)["pushes"]
    assert push["impulse_n_s"] == pytest.approx(MASS * 0.6)
    assert push["absorbed_energy_j"] == pytest.approx(0.5 * MASS * 0.6**2)
    assert push["force_n"] == pytest.approx(MASS * 0.6 / 0.1)
    assert push["duration_s"] == pytest.approx(0.1)
    assert push["direction_deg"] == pytest.approx(90.0)


def test_sway_and_the_time_of_the_recovery(log):
    """Oracles: tan; the last row, put in by hand, with an error of 5 cm."""
    com = signal_view(log, "com_state")
    feet = signal_view(log, "walking_signal")
    com.position[:] = 0.0
    com.z[:] = 0.9
    for foot in feet.left, feet.right:
        foot[:] = 0.0
    com.x[300] = -0.9 * math.tan(math.radians(12.0))
    log["icp"][:] = log["icp_reference"][:, :2]
    log["icp"][1500, 1] += 0.06
    summary = summary_of(log)
    assert summary["body_sway_deg"] == pytest.approx(12.0)
    assert summary["recovery_time_s"] == pytest.approx(1500 * 0.002 - 1.976)


@pytest.mark.parametrize(
    ("name", "rows", "value", "reason"),
    [
        ("state", 200, -20.3, ""),
        ("state", 200, -20.5, "too fast: a joint at 102.5 % of its limit"),
        ("state", 200, np.nan, "too fast: a joint at nan % of its limit"),
        ("actuation", 200, 300.0, ""),
        ("actuation", 200, -301.0, "a torque was above its limit"),
        ("icp", slice(-50, None), 0.6, RESTLESS),
        ("icp", -1, np.nan, RESTLESS),
    ],
)
def test_a_limit_may_be_reached_and_not_passed(log, name, rows, value, reason):
    log[name][rows, -2] = value
    summary = summary_of(log)
    assert summary["recovered"] is not bool(reason)
    assert summary["reason"].startswith(reason)


def test_torques_of_drives_step_by_what_is_usual_in_a_tick(log):
    """Oracle: by hand: of the worst joint in each tick the median."""
    limits, steps = log["effort_limits"], np.zeros((len(log["t"]), 2))
    steps[1::2] = 0.03, 0.01  # of joints 2 and 5, in every other row
    steps[:: len(steps) // 3, 0] = 0.9  # seldom
    log["torques"][:] = 0.0
    log["torques"][:, [2, 5]] = steps * limits[[2, 5]]
    log["actuation"][1::2] = 0.5 * limits  # commands do not count
    assert summary_of(log)["torque_step_ratio"] == pytest.approx(0.03)
    assert summary_of(cut(log, 1))["torque_step_ratio"] is None


@pytest.mark.parametrize(
    ("steps", "command", "outcome"),
    [
        (0, [0.0, 0.0, 0.0], "recovered"),
        (0, [0.02, 0.0, 0.0], "recovered"),  # told to step in place
        (0, [0.3, 0.0, 0.0], "failed"),
        (0, [0.0, 0.0, -0.3], "failed"),
        (6, [0.3, 0.0, 0.0], "recovered"),
    ],
)
def test_a_policy_that_is_held_still_stands(steps, command, outcome):
    """Oracle: what it is told, of a robot without an ICP that stays upright."""
    log = make_log(Recipe(num_steps=steps, pushed_step=None, changed={}))
    if steps:
        log = cut(log, round(7.0 / T))  # it lands at 5.5 and 6.5 s
    log["t"] = log["t"] * max(1.0, 3.0 / log["t"][-1])
    del log["icp"], log["icp_reference"]
    log["velocity_command"] = np.tile(command, (len(log["t"]), 1))
    assert summary_of(log)["outcome"] == outcome
