"""Pushes on the robot, at a time or at a point of the gait."""

import math

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.push import Push
from nadia_balance.core.ticks import number_of_ticks
from nadia_balance.core.walking import WalkingState
from nadia_balance.systems.ports import declare_input, eval_typed

# Numbers of ticks left of a push that is not yet due: its phase has not begun,
# or it has.
PENDING, EXPECTED = -1.0, -2.0


class PushSource(LeafSystem):
    """Applies each push once, for exactly duration / period ticks.

    A push whose phase is over before its time, because the clock was advanced
    or the foot landed early, begins in the first tick after it.
    The force acts at the centre of mass of the pushed body.  `push_force` is
    the sum of the forces [N] in W, shape (3,).  Whenever the count in the
    optional input `live_push`, [count, delta_v [m/s], direction [deg]], has
    increased, one more such push begins; it replaces the last of its kind.

    State, for each push and then for the live one: [ticks left, its angle
    [rad] in W since it was due]; in the end [the live force while it acts [N],
    last count].  The outputs depend on nothing else.  A push is decided on in
    the update at one tick and felt by a discrete plant from its next step on.
    Without a plant (a point mass) there is no port `spatial_forces`.

    .. pydrake_system::

        name: PushSource
        input_ports: [walking_state, live_push]
        output_ports: [push_force, spatial_forces]
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

        Raises:
            ValueError: an invalid push, an unknown body, or a duration or
                delay that is not a multiple of `period`.
        """
        super().__init__()
        for push in pushes:
            push.validate()
        self._pushes, self._mass, self._period = list(pushes), mass, period
        self._ticks = [_ticks("duration", p.duration, period) for p in pushes]
        self._delays = [_ticks("delay", p.delay, period) for p in pushes]
        self._newtons = [p.newtons(mass) for p in pushes]
        self._walking_state = declare_input(self, "walking_state", object())
        self._live_push = self.DeclareVectorInputPort("live_push", 3)
        self._state = self.DeclareDiscreteState(
            [*np.tile([PENDING, 0.0], len(pushes)), 0.0, 0.0, 0.0, 0.0]
        )
        state_only = {self.discrete_state_ticket(self._state)}
        self.DeclareVectorOutputPort(
            "push_force", 3, self._calc_total, prerequisites_of_calc=state_only
        )
        if plant is not None:
            names = [p.body or base_body for p in pushes] + [base_body]
            self._bodies = [_body(plant, name) for name in names]
            self.DeclareAbstractOutputPort(
                "spatial_forces",
                alloc=lambda: AbstractValue.Make(
                    [ExternallyAppliedSpatialForce()]
                ),
                calc=self._calc_spatial,
                prerequisites_of_calc=state_only,
            )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _rows(self, context) -> np.ndarray:
        state = context.get_discrete_state(self._state).value()
        return state.reshape(-1, 2)

    def _update(self, context, state):
        rows = self._rows(context).copy()
        for i, push in enumerate(self._pushes):
            if rows[i, 0] > 0.0:
                rows[i, 0] -= 1.0
            elif rows[i, 0] < 0.0:
                ticks = self._delays[i] + self._ticks[i]
                self._await(context, push, ticks, rows[i])
        if self._live_push.HasValue(context):
            self._update_live(context, rows[-2], rows[-1])
        state.set_value(self._state, rows.ravel())
        return EventStatus.Succeeded()

    def _await(self, context, push: Push, ticks: int, row) -> None:
        """Changes the `row` of a push that has not begun."""
        walking = eval_typed(self, context, self._walking_state, WalkingState)
        due = push.is_due(context.get_time(), walking, self._period)
        if due or push.is_in_phase(walking):
            row[:] = ticks if due else EXPECTED, _angle(push, walking)
        elif row[0] == EXPECTED:  # over too soon
            row[0] = ticks

    def _update_live(self, context, push_row, live_row) -> None:
        """Changes the last two rows of the state."""
        count, delta_v, direction_deg = self._live_push.Eval(context)
        if push_row[0] > 0.0:
            push_row[0] -= 1.0
        if count > live_row[1]:
            push = Push(delta_v=delta_v, time=0.0, direction_deg=direction_deg)
            push.validate()
            walking = eval_typed(
                self, context, self._walking_state, WalkingState
            )
            ticks = number_of_ticks(push.duration, self._period)
            push_row[:] = ticks, _angle(push, walking)
            live_row[0] = push.newtons(self._mass)
        elif push_row[0] == 0.0:
            live_row[0] = 0.0
        live_row[1] = count

    def _forces(self, context) -> list[tuple[int, np.ndarray]]:
        """The pushes that act now, as (number, force (3,) [N] in W)."""
        *rows, (live_newtons, _) = self._rows(context).tolist()
        newtons = [*self._newtons, live_newtons]
        longest = [*self._ticks, math.inf]  # what is more is a delay
        active = []
        for i, (left, angle) in enumerate(rows):
            if 0.0 < left <= longest[i]:
                heading = np.array([math.cos(angle), math.sin(angle), 0.0])
                active.append((i, newtons[i] * heading))
        return active

    def _calc_total(self, context, output):
        forces = (force for _, force in self._forces(context))
        output.set_value(sum(forces, np.zeros(3)))

    def _calc_spatial(self, context, output):
        forces = []
        for i, f_W in self._forces(context):
            applied = ExternallyAppliedSpatialForce()
            applied.body_index, applied.p_BoBq_B = self._bodies[i]
            applied.F_Bq_W = SpatialForce(tau=np.zeros(3), f=f_W)
            forces.append(applied)
        output.set_value(forces)


def _angle(push: Push, state: WalkingState) -> float:
    """The direction in W [rad]: that of the push, from the support foot's."""
    schedule = state.schedule
    yaw = schedule.feet[schedule.support_side].yaw
    return yaw + math.radians(push.direction_deg)


def _ticks(name: str, time: float, period: float) -> int:
    ticks = round(time / period)
    if abs(ticks * period - time) > 1e-9:
        raise ValueError(f"{name} = {time}: must be a multiple of {period} s")
    return ticks


def _body(plant: MultibodyPlant, name: str):
    if not plant.HasBodyNamed(name):
        raise ValueError(f"body = {name!r}: must be a body of the robot")
    body = plant.GetBodyByName(name)
    return body.index(), body.default_com()
