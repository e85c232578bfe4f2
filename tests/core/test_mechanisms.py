"""Oracle: the fields that each switch stands for, by hand."""

from dataclasses import fields, replace
from itertools import product

import pytest

from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.mechanisms import (
    Mechanisms,
    mechanisms_of,
    switched_adjuster,
    switched_timing,
)
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.time_adjustment import TimingAdapterParams

TIMING = TimingAdapterParams(swing_time_constant=0.02)
ADJUSTER = CaptureRegionStepAdjusterParams(
    margin=0.02, reachability=ReachabilityParams(width_max=0.7)
)
SWITCHES = [Mechanisms(*on) for on in product([False, True], repeat=4)]


@pytest.mark.parametrize("on", SWITCHES, ids=str)
def test_what_was_switched_is_found_again(on):
    """Oracle: the way back, for all sixteen."""
    timing, adjuster = (
        switched_timing(TIMING, on),
        switched_adjuster(ADJUSTER, on),
    )
    assert mechanisms_of(timing, adjuster) == on


@pytest.mark.parametrize("on", SWITCHES, ids=str)
def test_a_switch_is_the_field_of_its_name_and_no_other(on):
    """Oracle: by hand, field by field; the originals stay as they are."""
    before = repr((TIMING, ADJUSTER))
    assert switched_timing(TIMING, on) == TimingAdapterParams(
        swing_time_constant=0.02, swing=on.swing, transfer=on.transfer
    )
    assert switched_adjuster(ADJUSTER, on) == replace(
        ADJUSTER,
        enabled=on.step,
        reachability=ReachabilityParams(
            width_max=0.7, cross_over=on.cross_over
        ),
    )
    assert repr((TIMING, ADJUSTER)) == before


def test_the_order_of_the_vector_is_that_of_the_columns_of_fig_10():
    """Oracle: the Nadia paper's figure; ports rely on this order."""
    names = [field.name for field in fields(Mechanisms)]
    assert names == ["step", "swing", "transfer", "cross_over"]
