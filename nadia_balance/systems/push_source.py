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
from nadia_balance.core.walking import WalkingState
from nadia_balance.systems.ports import declare_input, eval_typed

PENDING = -1.0  # number of ticks left of a push that is not yet due


class PushSource(LeafSystem):
    """Applies each push once, for exactly duration / period ticks.

    The force acts at the centre of mass of the pushed body.  `push_force` is
    the sum of the forces [N] in W, shape (3,).  State, for each push: [ticks
    left, heading [rad] of the support foot when it was due]; the outputs
    depend on nothing else.  A push is decided on in the update at one tick
    and felt by a discrete plant from its next step on.  Without a plant (a
    point mass) there is no port `spatial_forces`.

    .. pydrake_system::

        name: PushSource
        input_ports: [walking_state]
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
        self._pushes = list(pushes)
        self._ticks = [_ticks("duration", p.duration, period) for p in pushes]
        self._delays = [_ticks("delay", p.delay, period) for p in pushes]
        self._newtons = [p.newtons(mass) for p in pushes]
        self._walking_state = declare_input(self, "walking_state", object())
        self._state = self.DeclareDiscreteState(
            np.tile([PENDING, 0.0], len(pushes))
        )
        state_only = {self.discrete_state_ticket(self._state)}
        self.DeclareVectorOutputPort(
            "push_force", 3, self._calc_total, prerequisites_of_calc=state_only
        )
        if plant is not None:
            self._bodies = [_body(plant, p.body or base_body) for p in pushes]
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
            elif rows[i, 0] == PENDING:
                walking = eval_typed(
                    self, context, self._walking_state, WalkingState
                )
                if push.is_due(context.get_time(), walking):
                    schedule = walking.schedule
                    yaw = schedule.feet[schedule.support_side].yaw
                    rows[i] = self._delays[i] + self._ticks[i], yaw
        state.set_value(self._state, rows.ravel())
        return EventStatus.Succeeded()

    def _forces(self, context) -> list[tuple[int, np.ndarray]]:
        """The pushes that act now, as (number, force (3,) [N] in W)."""
        active = []
        for i, (left, yaw) in enumerate(self._rows(context)):
            if 0.0 < left <= self._ticks[i]:
                angle = yaw + math.radians(self._pushes[i].direction_deg)
                heading = np.array([math.cos(angle), math.sin(angle), 0.0])
                active.append((i, self._newtons[i] * heading))
        return active

    def _calc_total(self, context, output):
        output.SetFromVector(
            sum((f for _, f in self._forces(context)), np.zeros(3))
        )

    def _calc_spatial(self, context, output):
        forces = []
        for i, f_W in self._forces(context):
            applied = ExternallyAppliedSpatialForce()
            applied.body_index, applied.p_BoBq_B = self._bodies[i]
            applied.F_Bq_W = SpatialForce(tau=np.zeros(3), f=f_W)
            forces.append(applied)
        output.set_value(forces)


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
