"""Pushes on the robot, at a time or at an event of the gait."""

import math
from dataclasses import replace

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)
from pydrake.multibody.tree import RigidBody
from pydrake.systems import framework
from pydrake.systems.framework import Context

from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.push import TIME_TOLERANCE, Push
from nadia_balance.core.walking.state import Phase, Side, whole_ticks
from nadia_balance.parameters.bounds import check
from nadia_balance.systems.ports import declare_cache, declare_output, inputs

LOADED = 0.05  # share of the weight above which a foot is in contact [-]
BOUNCE = 0.06  # shortest swing that is measured [s]
# "Ticks left" of a push that has not begun: before its phase, and within it.
_PENDING, _EXPECTED = -1.0, -2.0


class PushSource(framework.LeafSystem):
    """Computes push forces; each push acts once, for duration / period ticks.

    A push whose phase ends before the push is due, because the clock was
    advanced or the foot landed early, begins in the first tick after the phase.
    The force acts at the centre of mass of the pushed body, or at its `point`.
    Whenever the count in the optional input `live_push` increases, a live push
    begins, with a number of its own; it replaces the previous live push.

    Numeric parameter i: [peak force [N], direction [deg]] of push i, so that
    copies of one Context can have different pushes (see `set_push`).  Without a
    `walking_state` (a ContactClock has one), pushes can only begin at a time,
    and their directions are relative to W.  State, for each push and then for
    the live one: [ticks left, heading [rad] in W (of the support foot until the
    push begins, then of the force), peak force [N]]; the last three entries are
    the last count, the number of live pushes, and the duration of the last one
    in ticks.  The outputs depend on the state only.  The update of a tick
    starts a push; a discrete plant applies its force from the next step on.
    `spatial_forces` exists only with a plant.

    .. pydrake_system::

        name: PushSource
        input_ports: [walking_state, live_push]
        output_ports: [push_force, push_signal, spatial_forces]
    """

    def __init__(
        self,
        pushes: list[Push],
        mass: float,
        period: float,
        plant: MultibodyPlant | None = None,
        base_body: str = "",
    ):
        """Pushes a robot of this `mass` [kg]; decides every `period` [s].

        `base_body` names the body of `plant` for pushes that name none.

        Raises ValueError: an invalid push, an unknown body, or a duration or
        delay that is not a multiple of `period`.
        """
        super().__init__()
        for push in pushes:
            check(push)
            whole_ticks("duration", push.duration, period)
        self._pushes, self._mass, self.period = list(pushes), mass, period
        self._shares = [push.shares(period) for push in pushes]
        self._effective = [push.effective_duration(period) for push in pushes]
        self._delays = [whole_ticks("delay", p.delay, period) for p in pushes]
        # Before these times a push is not looked at [s]; the last one is live.
        moments = [push.moment for push in pushes]
        times = [-math.inf if m.phase else m.time for m in moments]
        self._not_before = np.array([*times, 0.0])
        (self._walking_state,) = inputs(self, "walking_state?")
        self._live_push = self.DeclareVectorInputPort("live_push", 4)
        for push in pushes:
            size = [push.newtons(mass, period), push.direction_deg]
            self.DeclareNumericParameter(framework.BasicVector(size))
        self._state = self.DeclareDiscreteState(
            [*([_PENDING, 0.0, 0.0] * len(pushes)), *np.zeros(6)]
        )
        needs = [self.discrete_state_ticket(self._state)]
        self._active = declare_cache(self, "active", self._calc_active, needs)
        needs.append(self._active.ticket())
        declare_output(self, "push_force", self._calc_force, needs)
        declare_output(self, "push_signal", self._calc_signal, needs)
        if plant is not None:
            self._bodies, live = [], Push(at="0 s")
            for push in [*pushes, live]:
                body = find_body(plant, push.body or base_body)
                at = push.point or body.default_com()
                self._bodies.append((body.index(), at))
            self.DeclareAbstractOutputPort(
                "spatial_forces",
                lambda: AbstractValue.Make([ExternallyAppliedSpatialForce()]),
                self._calc_spatial,
                set(needs),
            )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def set_push(
        self, context: Context, delta_v: float, direction_deg: float
    ) -> None:
        """Sets `delta_v` [m/s] and direction [deg] of the first push.

        It takes effect if the push has not begun; `context` is this system's.
        """
        newtons = self._mass * delta_v / self._effective[0]
        parameter = context.get_mutable_numeric_parameter(0)
        parameter.SetFromVector([newtons, direction_deg])

    def begins(self, context: Context) -> bool:
        """True if the first push begins in an update of this `context`."""
        row = self._rows(context)[0].copy()
        if row[0] < 0.0:
            self._await(context, self._walking_state(context), 0, row)
        return row[0] > 0.0

    def _rows(self, context: Context) -> np.ndarray:
        """Ticks, heading and force of each push: a view of the state."""
        state = context.get_discrete_state(self._state).value()
        return state[:-3].reshape(-1, 3)

    def _live(self, context: Context) -> np.ndarray:
        """Count, number and ticks of the live pushes: a view of the state."""
        return context.get_discrete_state(self._state).value()[-3:]

    def _update(self, context, state):
        now = state.get_mutable_discrete_state(self._state)
        rows = self._rows(context).copy()
        count, number, ticks = self._live(context)
        waits = (rows[:, 0] < 0.0).any()
        walks = self._walking_state(context) if waits else None
        soon = context.get_time() + 2.0 * TIME_TOLERANCE
        near = (rows[:, 0] > 0.0) | (self._not_before <= soon)
        for i in np.flatnonzero(near & (rows[:, 0] != 0.0)):
            if rows[i, 0] > 0.0:
                rows[i, 0] -= 1.0
            else:
                self._await(context, walks, i, rows[i])
        if self._live_push.HasValue(context):
            clicks, *wish = told = self._live_push.Eval(context).tolist()
            if not np.isfinite(told).all():
                at = f"at {context.get_time():.3f} s"
                raise ValueError(f"live_push = {told} {at}: must be finite")
            if clicks > count:
                push = Push(at="0 s")
                push.delta_v, push.direction_deg, push.duration = wish
                check(push)
                number += 1.0
                ticks = walking.number_of_ticks(push.duration, self.period)
                push.duration = ticks * self.period
                heading = _yaw(self._walking_state(context))
                heading += math.radians(push.direction_deg)
                newtons = push.newtons(self._mass, self.period)
                rows[-1] = ticks, heading, newtons
            count = clicks
        now.set_value([*rows.ravel(), count, number, ticks])
        return framework.EventStatus.Succeeded()

    def _await(self, context, walks, i: int, row) -> None:
        """Updates the state `row` of push `i`, which has not begun."""
        push = self._pushes[i]
        if walks is None and push.moment.phase is not None:
            raise RuntimeError(
                f"at = {push.at!r}: must be a time without a walking_state"
            )
        due = push.is_due(context.get_time(), walks, self.period)
        in_phase = push.is_in_phase(walks)
        if due or in_phase:
            row[:2] = _EXPECTED, _yaw(walks)
        if due or row[0] == _EXPECTED and not in_phase:  # due, or phase over
            newtons, direction_deg = context.get_numeric_parameter(i).value()
            ticks = len(self._shares[i]) + self._delays[i]
            row[:] = ticks, row[1] + math.radians(direction_deg), newtons

    def _calc_active(self, context, _) -> list[tuple[int, int, np.ndarray]]:
        """Index, ticks passed and force (3,) [N] in W of the active pushes."""
        active, rows = [], self._rows(context)
        if not (rows[:, 0] > 0.0).any():
            return active
        # The last push is the live one.
        shares = [*self._shares, np.ones(round(self._live(context)[2]))]
        for i, (left, heading, newtons) in enumerate(rows.tolist()):
            if 0.0 < left <= len(shares[i]):  # more ticks left: in its delay
                passed = len(shares[i]) - round(left)
                along = np.array([math.cos(heading), math.sin(heading), 0.0])
                force = newtons * shares[i][passed] * along
                active.append((i, passed, force))
        return active

    def _calc_force(self, context) -> np.ndarray:
        return sum((f for *_, f in self._active.Eval(context)), np.zeros(3))

    def _calc_signal(self, context) -> list[float]:
        number, delta_v, force = 0, 0.0, np.zeros(3)
        rows = self._rows(context)
        active = self._active.Eval(context)
        if active:
            i, _, force = min(active, key=lambda push: (push[1], -push[0]))
            _, count, ticks = self._live(context)
            is_live = i == len(self._pushes)
            number = i + (count if is_live else 1)
            effective = ticks * self.period if is_live else self._effective[i]
            delta_v = rows[i, 2] * effective / self._mass
        waiting = np.count_nonzero(rows[:-1, 0])
        return [number, delta_v, *force, waiting]

    def _calc_spatial(self, context, output):
        forces = []
        for i, _, f_W in self._active.Eval(context):
            applied = ExternallyAppliedSpatialForce()
            applied.body_index, applied.p_BoBq_B = self._bodies[i]
            applied.F_Bq_W = SpatialForce(tau=np.zeros(3), f=f_W)
            forces.append(applied)
        output.set_value(forces)


class ContactClock(framework.LeafSystem):
    """Computes the phase of any controller's gait from the forces on the feet.

    A foot swings while only the other one has more than LOADED of the weight.
    Between two swings is a transfer to the foot that has landed; if that is off
    the ground again within BOUNCE, it bounces.  A phase lasts as long as
    the last one of its kind and side; before there was one, the robot stands.
    Of the `walking_state`, phase, support side, duration, time in the phase and
    steps are known; both feet are at the origin of W.  The state is [1 in a
    swing, else 0; side that swings, now or next (+1 left); time in the phase
    [s]; steps; last durations [s] of right transfer, right swing, left transfer
    and left swing].

    .. pydrake_system::

        name: ContactClock
        input_ports: [foot_forces]
        output_ports: [walking_state]
    """

    def __init__(self, weight: float, period: float):
        """Reads the feet of a robot of this `weight` [N] every `period` [s]."""
        super().__init__()
        self._least, self._period = LOADED * weight, period
        (self._forces,) = inputs(self, "foot_forces")
        self._state = self.DeclareDiscreteState(8)
        needs = [self.discrete_state_ticket(self._state)]
        declare_output(self, "walking_state", self._calc_walking, needs)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)
        feet = walking.FootPoses(walking.ORIGIN, walking.ORIGIN)
        self._schedule = walking.ContactSchedule(
            *(Phase.STANDING, Side.LEFT, math.inf, feet, ()),
            walking.ReferencePoint(*np.zeros((3, 2))),
        )

    def _update(self, context, state):
        now = state.get_mutable_discrete_state(self._state)
        swings, side, time, steps, *lasted = now.value().tolist()
        left, right = self._forces(context) > self._least
        lifted = float(right) - float(left)  # +1: only the left foot
        bounces = not swings and lifted == -side and time < BOUNCE
        if not (left or right) or lifted == swings * side or bounces:
            now[2] = time + self._period
        else:
            if side:
                lasted[int(side + 1.0 + swings)] = time + self._period
            side = lifted or -side
            now.set_value([abs(lifted), side, 0.0, steps + swings, *lasted])
        return framework.EventStatus.Succeeded()

    def _calc_walking(self, context) -> walking.WalkingState:
        state = context.get_discrete_state(self._state).value().tolist()
        swings, side, time, steps, *lasted = state
        schedule = self._schedule
        if duration := lasted[int(side + 1.0 + swings)]:
            schedule = replace(
                schedule,
                phase=Phase.SWING if swings else Phase.TRANSFER,
                support_side=Side.RIGHT if side > 0.0 else Side.LEFT,
                duration=duration,
            )
        return walking.WalkingState(schedule, time, steps_taken=int(steps))


def _yaw(state: walking.WalkingState | None) -> float:
    """Yaw of the support foot in W [rad], 0 without a walking state."""
    if state is None:
        return 0.0
    schedule = state.schedule
    return schedule.feet[schedule.support_side].yaw


def find_body(plant: MultibodyPlant, name: str) -> RigidBody:
    """Returns the body `name` of the `plant`.

    Raises ValueError: the plant has no such body.
    """
    if name == "world" or not plant.HasBodyNamed(name):
        raise ValueError(f"body = {name!r}: must be a body of the robot")
    return plant.GetBodyByName(name)
