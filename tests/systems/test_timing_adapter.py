"""Oracle: core.time_adjustment, called with the same values."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from nadia_balance.core.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.swing_detour import SwingDetourParams
from nadia_balance.core.time_adjustment import (
    TimingAdapterParams,
    time_adjustment,
)
from nadia_balance.core.walking import WalkingState
from nadia_balance.systems.timing_adapter import TimingAdapter
from tests.example_walks import OMEGA, SOLE, successor, walk

PERIOD = 0.002  # [s]
PARAMS = TimingAdapterParams()
DETOUR = SwingDetourParams()
OFF = TimingAdapterParams(swing=False, transfer=False)
PORTS = ("icp", "icp_plan", "walking_state", "foot_poses")


def inputs(ahead=0.5, transfer=False):
    """The values of all ports, in the first swing; the ICP is ahead [s].

    Or in the first `transfer`.
    """
    schedule = walk(length=0.0)
    plan = plan_icp(schedule, SOLE, IcpPlanParams(), OMEGA)
    if not transfer:
        schedule = successor(schedule, plan)
        plan = plan_icp(schedule, SOLE, IcpPlanParams(), OMEGA)
    icp = plan.at(0.1 + ahead).icp
    return icp, plan, WalkingState(schedule, 0.1, 0.1), schedule.feet


def adapter_with(values, params=PARAMS, period=PERIOD):
    """A context in which the ports have `values`, and its output."""
    adapter = TimingAdapter(params, SOLE, DETOUR, period)
    context = adapter.CreateDefaultContext()
    for name, value in zip(PORTS, values, strict=True):
        if value is not None:
            fixed = value if name == "icp" else Value(value)
            adapter.GetInputPort(name).FixValue(context, fixed)
    return adapter.GetOutputPort("time_adjustment"), context


def switch(output, context, *, swing=0, transfer=0):
    port = output.get_system().GetInputPort("mechanisms")
    port.FixValue(context, [0, swing, transfer, 0])


@pytest.mark.parametrize("period", [PERIOD, 0.01])
@pytest.mark.parametrize("ahead", [0.0, 0.4, 0.5])
def test_proposes_what_the_core_says(ahead, period):
    """Oracle: the core function, to the last bit."""
    values = icp, plan, state, feet = inputs(ahead)
    output, context = adapter_with(values, period=period)
    expected = time_adjustment(
        icp, plan, state, lambda: feet, SOLE, DETOUR, PARAMS, period
    )
    assert output.Eval(context) == np.array([expected])
    assert (expected > 0.0) is (ahead > 0.0)


@pytest.mark.parametrize("transfer", [False, True])
@pytest.mark.parametrize("params", [PARAMS, OFF], ids=["on", "off"])
def test_switches_do_what_the_parameters_would(transfer, params):
    """Oracle: an adapter with those parameters; the other switch does not."""
    values = inputs(0.15 if transfer else 0.5, transfer)
    output, context = adapter_with(values, params)
    always, other = adapter_with(values)
    expected = always.Eval(other).copy()
    assert expected > 0.0
    phases = ("swing", "transfer")
    for name in (*phases, *phases):
        switch(output, context, **{name: 1})
        mine = (name == "transfer") is transfer
        assert output.Eval(context) == (expected if mine else 0.0)


@pytest.mark.parametrize("params", [PARAMS, OFF], ids=["on", "off"])
def test_asks_where_the_feet_are_only_if_it_is_on(params):
    """Oracle: the error of a port that has no value."""
    output, context = adapter_with([*inputs()[:3], None], params)
    if params is OFF:
        assert output.Eval(context) == [0.0]
    else:
        with pytest.raises(RuntimeError, match="foot_poses"):
            output.Eval(context)


def test_has_no_memory():
    """Oracle: a second evaluation, and a context without state."""
    output, context = adapter_with(inputs())
    first = output.Eval(context).copy()
    context.SetTime(0.002)
    assert output.Eval(context) == first
    assert context.num_total_states() == 0


@pytest.mark.parametrize("index", range(4))
def test_a_missing_input_raises(index):
    """Oracle: Drake's own message."""
    values = list(inputs())
    values[index] = None
    output, context = adapter_with(values)
    with pytest.raises(RuntimeError, match=f"{PORTS[index]}.*not connected"):
        output.Eval(context)


@pytest.mark.parametrize("index", [1, 2, 3])
def test_a_wrong_type_raises(index):
    """Oracle: the message names the port and both types."""
    values = list(inputs())
    values[index] = object()
    output, context = adapter_with(values)
    with pytest.raises(TypeError, match=f"{PORTS[index]}' got a object, needs"):
        output.Eval(context)


def test_refuses_bad_params():
    """Oracle: the validation of the params."""
    with pytest.raises(ValueError, match=r"max_speed_up = 0\.5: must be >= 1"):
        adapter_with(inputs(), TimingAdapterParams(max_speed_up=0.5))


def test_params_survive_yaml():
    """Oracle: what was dumped; a partial override keeps the other defaults."""
    text = yaml_dump_typed(PARAMS)
    assert yaml_load_typed(schema=TimingAdapterParams, data=text) == PARAMS
    loaded = yaml_load_typed(
        schema=TimingAdapterParams,
        data="{swing: false, min_transfer_duration: 0.03}",
        defaults=TimingAdapterParams(),
    )
    assert loaded == TimingAdapterParams(
        swing=False, min_transfer_duration=0.03
    )
