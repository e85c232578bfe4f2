"""Swing-foot reference, continuous when the step is re-planned."""

import numpy as np
from pydrake.common.containers import namedview
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.bounds import check
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.swing_clearance import SwingEdges, edges_on_way
from nadia_balance.core.swing_foot import (
    FootMotion,
    SwingFootParams,
    swing_foot_motion,
    velocity_now,
)
from nadia_balance.core.walking import ContactSchedule, WalkingState
from nadia_balance.systems.ports import (
    Outcome,
    ValueInput,
    declare_cache,
    entries,
    size,
)


class SwingFootReference(
    namedview(
        "SwingFootReference",
        [
            *("x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az"),
            *("yaw", "yaw_rate", "yaw_acceleration"),
        ],
    )
):
    """The motion of a sole in W: [m], [rad] and their time derivatives [s].

    Its twelve entries are those of core's FootMotion.
    """

    position, velocity, acceleration = (
        entries(0, 3),
        entries(3, 6),
        entries(6, 9),
    )


class SwingFootPlanner(LeafSystem):
    """Computes the swing foot's reference, continued from its last value.

    The reference clears the edges of uneven ground that the model contains.
    `walking_state` is a WalkingState; `swing_foot_reference` is the
    SwingFootReference of the foot that swings, or swings next: like the state
    of a StatePredictor, positions a `lead` ahead, velocities not.  The discrete
    state is the output of the last tick, and the motion without the lead.

    .. pydrake_system::

        name: SwingFootPlanner
        input_ports: [walking_state]
        output_ports: [swing_foot_reference]
    """

    def __init__(
        self,
        params: SwingFootParams,
        model: PointMassModel,
        period: float,
        lead: float = 0.0,
    ):
        """Follows the walking state every `period` [s], a `lead` [s] ahead.

        Raises ValueError for `params` that are out of range.
        """
        super().__init__()
        check(params)
        self._params, self._model = params, model
        self._period, self._lead = period, lead
        self._walking_state = ValueInput(self, "walking_state", WalkingState)
        self._edges = declare_cache(
            self,
            "edges",
            self._calc_edges,
            {self._walking_state.ticket()},
            (None, None),
        )
        # The initial state is not used: the first swing begins at the pose of
        # the standing foot.
        Outcome(
            self,
            {
                "swing_foot_reference": size(SwingFootReference),
                "motion": size(SwingFootReference),
            },
            1,
            self._calc,
            {self._walking_state.ticket(), self._edges.ticket()},
            period,
        )

    def _calc_edges(
        self, context, last: tuple[ContactSchedule | None, SwingEdges | None]
    ) -> tuple[ContactSchedule | None, SwingEdges | None]:
        schedule = self._walking_state(context).schedule
        if schedule is last[0]:
            return last
        clearance = self._params.clearance
        return schedule, edges_on_way(schedule, self._model, clearance)

    def _calc(self, context, last) -> np.ndarray:
        motion, ahead = swing_foot_motion(
            FootMotion.from_vector(last["motion"]),
            self._walking_state(context),
            self._period,
            self._params,
            self._model,
            self._lead,
            self._edges.Eval(context)[1],
        )
        reference = velocity_now(ahead.as_vector(), self._lead)
        return np.concatenate((reference, motion.as_vector()))
