"""The log holds what the ports had, and costs no second computation."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, EventStatus, LeafSystem

from diagrams.logs import SignalLog
from diagrams.simulation import start
from tests.diagrams.simulated import diagram_of

PERIOD = 0.002
REGIONS = ("base", "forward", "backward")


class Counter(LeafSystem):
    """Counts its updates, and how often its costly output is computed."""

    def __init__(self):
        super().__init__()
        self.num_calculations = 0
        state = self.DeclareDiscreteState(1)
        self.DeclareVectorOutputPort("count", 1, self._count)
        self.costly = self.DeclareVectorOutputPort("costly", 2, self._costly)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._update)
        self._state = state

    def _value(self, context):
        return context.get_discrete_state(self._state).value()[0]

    def _count(self, context, output):
        output[0] = self._value(context)

    def _costly(self, context, output):
        self.num_calculations += 1
        output.SetFromVector([context.get_time(), 10.0 * self._value(context)])

    def _update(self, context, state):
        costly = self.costly.Eval(context)
        state.set_value(self._state, [costly[1] / 10.0 + 1.0])
        return EventStatus.Succeeded()


@pytest.fixture
def counting():
    """A running counter: the system, its log, its simulator."""
    builder = DiagramBuilder()
    counter = builder.AddSystem(Counter())
    ports = {name: counter.GetOutputPort(name) for name in ("count", "costly")}
    log = SignalLog(builder, PERIOD, ports)
    return counter, log, Simulator(builder.Build())


def test_row_i_is_what_was_computed_in_tick_i(counting):
    """Oracle: the counter, which has i in tick i."""
    _, log, simulator = counting
    simulator.AdvanceTo(0.1)
    read = log.read(simulator.get_context())
    i = np.arange(50.0)
    assert list(read) == ["t", "count", "costly"]
    assert read["t"] == pytest.approx(PERIOD * i, abs=1e-12)
    assert np.array_equal(read["count"], i[:, None])
    assert np.array_equal(read["costly"], np.stack([read["t"], 10 * i], axis=1))


def test_a_signal_is_computed_once_a_tick(counting):
    """Oracle: the number of calls; an event of its own would double it."""
    counter, log, simulator = counting
    simulator.AdvanceTo(0.1)
    assert counter.num_calculations == len(
        log.read(simulator.get_context())["t"]
    )


@pytest.mark.parametrize("end", [0.002, 0.003, 0.0059])
def test_has_every_tick_that_is_complete(counting, end):
    """Oracle: the number of whole periods."""
    _, log, simulator = counting
    simulator.AdvanceTo(end)
    assert len(log.read(simulator.get_context())["t"]) == int(end / PERIOD)


def test_is_empty_before_the_start(counting):
    _, log, simulator = counting
    simulator.Initialize()
    read = log.read(simulator.get_context())
    assert read["t"].shape == (0,)
    assert read["costly"].shape == (0, 2)


@pytest.mark.parametrize("plant", ["lipm", "humanoid"])
def test_equals_the_ports_at_that_instant(plant):
    """Oracle: every logged port, evaluated by hand in the middle of a tick.

    That is where the abstract states, and that of a MultibodyPlant, are the
    new ones, and all other discrete states are the old ones.  Exactly equal.
    """
    text = "{gait: {num_steps: 2}, pushes: [{delta_v: 0.1, time: 0.2}]}"
    diagram = diagram_of(text, plant)
    simulator = start(diagram)
    k = 125  # within the push, which begins at 0.2 s = 100 ticks
    simulator.AdvanceTo(PERIOD * k)
    by_hand = simulator.get_context().Clone()
    simulator.AdvanceTo(PERIOD * k + 0.0004)  # the plant's step is 0.001 s
    copy_new_states(diagram, simulator.get_context(), by_hand)
    simulator.AdvanceTo(PERIOD * (k + 1))
    logs = diagram.read_logs(simulator.get_context())
    assert logs["t"][k] == pytest.approx(PERIOD * k)
    assert np.linalg.norm(logs["push_force"][k]) > 0.0
    ports = ports_of(diagram)
    rows = len(logs["t"])
    signals = [n for n, a in logs.items() if a.ndim == 2 and len(a) == rows]
    signals = set(signals) - {"foot_poses"}
    assert len(signals) >= 10
    for name in signals:
        context = ports[name].get_system().GetMyContextFromRoot(by_hand)
        assert np.array_equal(ports[name].Eval(context), logs[name][k]), name


@pytest.mark.parametrize("plant", ["lipm", "humanoid"])
def test_knows_where_a_foot_could_have_gone(plant):
    """Oracle: Figs. 5 and 8, at the width of a scenario; crossing is off."""
    width = "{reachability: {width_max: 0.6, width_forward: 0.2}}"
    text = f"{{controller: {{step_adjuster: {width}}}}}"
    diagram = diagram_of(text, plant)
    logs = diagram.read_logs(start(diagram).get_context())
    tips = [np.min(logs[f"region_{n}"][:, 1]) for n in REGIONS]
    assert tips == pytest.approx([0.125, -0.2, 0.05])
    assert np.max(logs["region_base"][:, 1]) == pytest.approx(0.6)


def copy_new_states(diagram, source, target):
    """Copies what a tick changes before anything is logged."""
    for system in all_systems(diagram):
        to = system.GetMyMutableContextFromRoot(target)
        since = system.GetMyContextFromRoot(source)
        if system.get_name() == "walking_state_machine":
            state = since.get_abstract_state(0).get_value()
            to.SetAbstractState(0, state)
        elif isinstance(system, MultibodyPlant):
            q_v = system.GetPositionsAndVelocities(since)
            system.SetPositionsAndVelocities(to, q_v)


def ports_of(diagram):
    """Name -> output port, under the names of the log."""
    ports = {
        port.get_name(): port
        for system in reversed(all_systems(diagram))
        for port in map(
            system.get_output_port, range(system.num_output_ports())
        )
    }
    if isinstance(diagram.plant, MultibodyPlant):
        ports["state"] = diagram.plant.get_state_output_port()
    return ports


def all_systems(diagram):
    """The systems in `diagram`, before those inside of them."""
    found = list(diagram.GetSystems())
    for system in diagram.GetSystems():
        if hasattr(system, "GetSystems"):
            found += all_systems(system)
    return found
