"""Pushes on the robot, at a time or at an event of the gait."""

import itertools
import math
from dataclasses import replace
from typing import Any, cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import BasicVector, Context, State

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.push import TIME_TOLERANCE, Push
from nadia_balance.core.walking.state import (
    WalkingState,
    number_of_ticks,
    whole_ticks,
)
from nadia_balance.parameters.bounds import check, check_number, require
from nadia_balance.systems.ports import (
    Block,
    check_period,
    declare_scratch,
    declare_update,
    input_port,
    optional_input,
)

_LIVE = Push(at="0 s", delta_v=0.0)  # a push like the live one
# "Ticks left" of a push that has not begun: before its phase, and within it.
_PENDING = -1.0
_EXPECTED = -2.0


class PushSource(Block):
    """Computes push forces; each push acts once, for duration / period ticks.

    A push whose phase ends before the push is due, because the clock was
    advanced or the foot landed early, begins in the first tick after the phase.
    The force acts at the centre of mass of the pushed body, or at its `point`.
    Whenever the count in the optional input `live_push` increases, a live push
    begins, with a number of its own; it replaces the previous live push.

    Numeric parameter i: [peak force [N], direction [deg]] of push i, so that
    copies of one Context can have different pushes (see `set_push`).  Without a
    `walking_state` (a ContactClock has one), pushes can only begin at a time,
    and their directions are relative to W.  The outputs are state.  Its other
    part is, for each push and then for the live one: [ticks left, heading [rad]
    in W (of the support foot until the push begins, then of the force), peak
    force [N]]; the last three entries are the last count, the number of live
    pushes, and the duration of the last one in ticks.  The update of a tick
    starts a push; a discrete plant applies its force from the next step on.
    `spatial_forces` exists only with a plant.  A push in the `frame` of a body
    turns with it from tick to tick; the plant's `state`, [q, v], is an input
    only with such pushes.

    Args:
        pushes: the pushes, which act once each.
        mass: mass of the robot [kg].
        period: time between two decisions [s].
        plant: plant with the pushed bodies; None: no `spatial_forces`.
        base_body: name of the body of pushes that name none.

    Raises:
        ValueError: an invalid push, an unknown body, or a duration or
            delay that is not a multiple of `period`.

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
    ) -> None:
        super().__init__()
        check_number("mass", mass, above=0.0, unit="kg")
        check_period(period)
        for i, push in enumerate(pushes):
            check(push, f"pushes[{i}]")
            whole_ticks(f"pushes[{i}].duration", push.duration, period)
        self._pushes = list(pushes)
        self._mass = mass
        self.period = period
        self._shares = [push.shares(period) for push in pushes]
        self._effective = [push.effective_duration(period) for push in pushes]
        self._delays = [
            whole_ticks(f"pushes[{i}].delay", push.delay, period)
            for i, push in enumerate(pushes)
        ]
        # Before these times a push is not looked at [s]; the last one is live.
        self._not_before = [
            *(
                -math.inf if push.moment.phase else push.moment.time
                for push in pushes
            ),
            0.0,
        ]
        self._walking = optional_input(self, "walking_state")
        self._live_push = self.DeclareVectorInputPort("live_push", 4)
        for push in pushes:
            parameter: Any = [push.newtons(mass, period), push.direction_deg]
            self.DeclareNumericParameter(BasicVector(parameter))
        self._memory: Any = self.DeclareDiscreteState(
            cast(Any, [*([_PENDING, 0.0, 0.0] * len(pushes)), *np.zeros(6)])
        )
        self._force: Any = self.DeclareDiscreteState(3)
        self._signal: Any = self.DeclareDiscreteState(
            cast(Any, [*np.zeros(5), len(pushes)])
        )
        self.DeclareStateOutputPort("push_force", self._force)
        self.DeclareStateOutputPort("push_signal", self._signal)
        self._applies = plant is not None
        self._frames: dict[int, RigidBody] = {}  # by the number of a push
        if plant is not None:
            self._declare_spatial(plant, base_body)
            self._declare_frames(plant)
        else:
            for push in pushes:
                require(
                    not push.frame,
                    f"frame = {push.frame!r}: must be empty without links",
                )
        declare_update(self, period, self._update)

    def _declare_spatial(self, plant: MultibodyPlant, base_body: str) -> None:
        """Declares `spatial_forces`, at first none, on bodies of the plant."""
        self._bodies = []
        for push in [*self._pushes, _LIVE]:
            body = find_body(plant, push.body or base_body)
            self._bodies.append(
                (body.index(), push.point or body.default_com())
            )
        forces = AbstractValue.Make([ExternallyAppliedSpatialForce()])
        forces.set_value([])
        self._spatial = self.DeclareAbstractState(forces)
        self.DeclareStateOutputPort("spatial_forces", self._spatial)

    def _declare_frames(self, plant: MultibodyPlant) -> None:
        """Declares the input that tells how the bodies of frames turn."""
        self._frames = {
            i: find_body(plant, push.frame, "frame")
            for i, push in enumerate(self._pushes)
            if push.frame
        }
        if self._frames:
            size = plant.num_multibody_states()
            self._state = input_port(self, "state", size)
            self._plant = plant
            self._poses: Any = declare_scratch(self, plant)

    def set_push(
        self, context: Context, delta_v: float, direction_deg: float
    ) -> None:
        """Sets the first push; it takes effect if that has not begun.

        Args:
            context: that of this system.
            delta_v: velocity change of the robot's mass [m/s].
            direction_deg: 0 forward, 90 left [deg].

        Raises:
            ValueError: there is no push, or none of an impulse; or a number is
                out of its bounds.
        """
        require(bool(self._pushes), "pushes = []: must have a push")
        first = self._pushes[0]
        check(
            replace(
                first, delta_v=delta_v, direction_deg=direction_deg, force=None
            )
        )
        parameter: Any = context.get_mutable_numeric_parameter(0)
        parameter.SetFromVector(
            [self._mass * delta_v / self._effective[0], direction_deg]
        )

    def begins(self, context: Context) -> bool:
        """True if the first push begins in an update of a context.

        Args:
            context: that of this system.

        Returns:
            Whether it begins, or has begun and still acts.
        """
        row = self._remembered(context)[:3]
        if row[0] < 0.0:
            self._await(context, self._walking(context), i=0, row=row)
        return row[0] > 0.0

    def _remembered(self, context: Context) -> list[float]:
        """The part of the state that is no output."""
        memory: Any = context.get_discrete_state(self._memory).value()
        return cast(list[float], memory.tolist())

    def _update(self, context: Context, state: State) -> None:
        before = self._remembered(context)
        is_live = self._live_push.HasValue(context)
        if not (is_live or any(before[:-3:3])):
            return  # all pushes are over
        rows = [before[i : i + 3] for i in range(0, len(before) - 3, 3)]
        live = before[-3:]
        waits = any(row[0] < 0.0 for row in rows)
        walking_state = self._walking(context) if waits else None
        soon = context.get_time() + 2.0 * TIME_TOLERANCE
        for i, row in enumerate(rows):
            if row[0] > 0.0:
                row[0] -= 1.0
            elif row[0] < 0.0 and self._not_before[i] <= soon:
                self._await(context, walking_state, i=i, row=row)
        if is_live:
            self._take_live(context, live=live, row=rows[-1])
        memory = [*itertools.chain(*rows), *live]
        if memory != before:
            self._remember(context, state, rows=rows, live=live)

    def _remember(
        self,
        context: Context,
        state: State,
        rows: list[list[float]],
        live: list[float],
    ) -> None:
        """Sets the state: its memory, and the outputs that follow from it."""
        active = self._active(context, rows, live_ticks=round(live[2]))
        values: Any = state.get_mutable_discrete_state()
        values.set_value(self._memory, [*itertools.chain(*rows), *live])
        values.set_value(
            self._force, sum((force for *_, force in active), np.zeros(3))
        )
        values.set_value(self._signal, self._push_signal(active, rows, live))
        if self._applies:
            spatial: Any = state.get_mutable_abstract_state()
            spatial.get_mutable_value(self._spatial).set_value(
                [self._applied(i, force) for i, _, force in active]
            )

    def _take_live(
        self, context: Context, live: list[float], row: list[float]
    ) -> None:
        """Updates the state of the live pushes, and the `row` of the last."""
        command: Any = self._live_push.Eval(context)
        if not np.isfinite(command).all():
            raise ValueError(
                f"live_push = {command.tolist()} at "
                f"{context.get_time():.3f} s: must be finite"
            )
        count, delta_v, direction_deg, duration = command.tolist()
        if count > live[0]:
            push = Push(
                at="0 s",
                delta_v=delta_v,
                direction_deg=direction_deg,
                duration=duration,
            )
            check(push)
            ticks = number_of_ticks(push.duration, self.period)
            push.duration = ticks * self.period
            heading = _yaw(self._walking(context)) + math.radians(direction_deg)
            row[:] = ticks, heading, push.newtons(self._mass, self.period)
            live[1:] = live[1] + 1.0, ticks
        live[0] = count

    def _await(
        self, context: Context, walking_state: Any, i: int, row: list[float]
    ) -> None:
        """Updates the state `row` of push `i`, which has not begun."""
        push = self._pushes[i]
        if walking_state is None and push.moment.phase is not None:
            raise RuntimeError(
                f"at = {push.at!r}: must be a time without a walking_state"
            )
        due = push.is_due(context.get_time(), walking_state, self.period)
        in_phase = push.is_in_phase(walking_state)
        if due or in_phase:
            yaw = 0.0 if push.frame else _yaw(walking_state)
            row[:2] = _EXPECTED, yaw
        if due or row[0] == _EXPECTED and not in_phase:  # due, or phase over
            newtons, direction_deg = context.get_numeric_parameter(i).value()
            row[:] = (
                len(self._shares[i]) + self._delays[i],
                row[1] + math.radians(direction_deg),
                newtons,
            )

    def _active(
        self, context: Context, rows: list[list[float]], live_ticks: int
    ) -> list[tuple[int, int, Array]]:
        """Index, ticks passed and force (3,) [N] in W of the active pushes."""
        active: list[tuple[int, int, Array]] = []
        # The last push is the live one.
        shares = [*self._shares, np.ones(live_ticks)]
        for i, (left, heading, newtons) in enumerate(rows):
            if 0.0 < left <= len(shares[i]):  # more ticks left: in its delay
                passed = len(shares[i]) - round(left)
                along = self._along(context, i, heading)
                active.append((i, passed, newtons * shares[i][passed] * along))
        return active

    def _along(self, context: Context, i: int, heading: float) -> Array:
        """The direction (3,) in W of push `i`."""
        if i == len(self._pushes):
            return _LIVE.along(heading)
        along = self._pushes[i].along(heading)
        if i not in self._frames:
            return along
        poses = self._poses.Eval(context)
        self._plant.SetPositionsAndVelocities(poses, self._state(context))
        X_WB = self._plant.EvalBodyPoseInWorld(poses, self._frames[i])
        return np.asarray(X_WB.rotation() @ along)

    def _push_signal(
        self,
        active: list[tuple[int, int, Array]],
        rows: list[list[float]],
        live: list[float],
    ) -> list[float]:
        """The entries of the PushSignal."""
        number, delta_v, force = 0.0, 0.0, np.zeros(3)
        if active:
            i, _, force = min(active, key=lambda push: (push[1], -push[0]))
            _, count, ticks = live
            is_live = i == len(self._pushes)
            number = i + (count if is_live else 1)
            effective = ticks * self.period if is_live else self._effective[i]
            delta_v = rows[i][2] * effective / self._mass
        waiting = sum(row[0] != 0.0 for row in rows[:-1])
        return [number, delta_v, *force, waiting]

    def _applied(self, i: int, f_W: Array) -> ExternallyAppliedSpatialForce:
        """The force of push `i` on its body."""
        applied = ExternallyAppliedSpatialForce()
        body_index, p_BoBq_B = self._bodies[i]
        applied.body_index, applied.p_BoBq_B = body_index, cast(Any, p_BoBq_B)
        applied.F_Bq_W = SpatialForce(
            tau=cast(Any, np.zeros(3)), f=cast(Any, f_W)
        )
        return applied


def _yaw(state: WalkingState | None) -> float:
    """Yaw of the support foot in W [rad], 0 without a walking state."""
    if state is None:
        return 0.0
    return state.schedule.feet[state.schedule.support_side].yaw


def find_body(
    plant: MultibodyPlant, name: str, field: str = "body"
) -> RigidBody:
    """The body of a plant.

    Args:
        plant: the plant.
        name: name of the body.
        field: which has the name.

    Returns:
        The body.

    Raises:
        ValueError: the plant has no such body.
    """
    require(
        name != "world" and plant.HasBodyNamed(name),
        f"{field} = {name!r}: must be a body of the robot",
    )
    return plant.GetBodyByName(name)
