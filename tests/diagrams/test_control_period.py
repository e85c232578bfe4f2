"""Oracles: closed forms, and the bookkeeping of one tick after another."""

from dataclasses import asdict, replace

import pytest

from diagrams.control_period import at_control_period
from nadia_balance.capture_point_controller import ControllerParams

COUNTED = {
    "walking_state_machine": {"contact_ticks"},
    "timing_adapter": {"swing_discount", "transfer_discount"},
    "step_adjuster": {"return_ticks"},
}


def test_at_its_own_period_nothing_changes():
    """Oracle: every field; of the shares, but for rounding."""
    params = ControllerParams()
    same = at_control_period(params, params.control_period)
    for name in ("swing_discount", "transfer_discount"):
        share = getattr(params.timing_adapter, name)
        assert getattr(same.timing_adapter, name) == pytest.approx(share)
    same.timing_adapter = params.timing_adapter
    assert asdict(same) == asdict(params)


def test_changes_only_what_counts_ticks():
    """Oracle: every field, and the table above."""
    params = ControllerParams()
    before = asdict(params)
    after = asdict(at_control_period(params, 0.01))
    assert after.pop("control_period") == 0.01
    assert before.pop("control_period") == params.control_period
    for part, fields in before.items():
        changed = {k for k, v in fields.items() if after[part][k] != v}
        assert changed == COUNTED.get(part, set()), part
    assert asdict(ControllerParams()) == asdict(params)  # a copy


@pytest.mark.parametrize("share", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("ratio", [2, 5, 10])
def test_a_share_of_each_tick_comes_to_the_same(share, ratio):
    """Oracle: what is left after so many short ticks, one by one."""
    params = ControllerParams(control_period=0.001)
    params.timing_adapter = replace(
        params.timing_adapter, swing_discount=share, transfer_discount=share
    )
    left = 1.0
    for _ in range(ratio):
        left -= share * left
    timing = at_control_period(params, 0.001 * ratio).timing_adapter
    assert timing.swing_discount == pytest.approx(1.0 - left, abs=1e-12)
    assert timing.transfer_discount == pytest.approx(1.0 - left, abs=1e-12)


def test_ticks_last_as_long_but_there_is_one():
    """Oracle: by hand; 25 ticks of 2 ms are 5 of 10 ms, 2 are 0.4."""
    found = at_control_period(ControllerParams(control_period=0.002), 0.01)
    assert found.step_adjuster.return_ticks == 5
    assert found.walking_state_machine.contact_ticks == 1
    found = at_control_period(ControllerParams(control_period=0.002), 0.001)
    assert found.step_adjuster.return_ticks == 50
    assert found.walking_state_machine.contact_ticks == 4
