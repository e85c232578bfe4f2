"""A tour of waypoints, as velocity commands."""

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import Context

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.plan.waypoints import (
    Waypoint,
    WaypointParams,
    standing_place,
    velocity_to,
)
from nadia_balance.core.walking.state import Phase
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.ports import (
    TICK_TOLERANCE,
    Block,
    declare_output,
    input_port,
)


class WaypointFollower(Block):
    """Tells the velocity command that leads the pelvis to the next waypoint.

    Each waypoint counts from its time on; before the first one the command is
    to stand.  The pelvis stands as far from the feet as it is from the CoM now,
    which stands between them: by its arms, too.

    Args:
        waypoints: in order of time.
        robot: the robot that walks.
        limits: least and most velocity (2, 3) [m/s], [m/s], [rad/s] (see
            velocity_limits).

    Raises:
        ValueError: no waypoint, times that fall, or a number that is not
            finite.

    .. pydrake_system::

        name: WaypointFollower
        input_ports: [walking_state, foot_poses, com_state, predicted_state]
        output_ports: [velocity_command]
    """

    def __init__(
        self, waypoints: Sequence[Waypoint], robot: RobotModel, limits: Array
    ) -> None:
        super().__init__()
        self._params = WaypointParams()
        self._waypoints = list(waypoints)
        self._times = [one.time - TICK_TOLERANCE for one in waypoints]
        require(
            bool(self._times)
            and bool(np.isfinite(self._waypoints).all())
            and bool((np.diff(self._times) > 0.0).all()),
            f"waypoints = {self._waypoints}: must be finite, and in order of "
            "time",
        )
        self._limits, self._width = limits, robot.point_mass.step_width
        self._walking = input_port(self, "walking_state")
        self._feet = input_port(self, "foot_poses")
        self._com = input_port(self, "com_state")
        self._state = input_port(
            self,
            "predicted_state",
            robot.control_plant().num_multibody_states(),
        )
        declare_output(
            self,
            "velocity_command",
            self._calc,
            needs=[self.all_input_ports_ticket(), self.time_ticket()],
        )

    def _calc(self, context: Context) -> Array:
        number = bisect_right(self._times, context.get_time())
        if number == 0:
            return np.zeros(3)
        schedule = self._walking(context).schedule
        pelvis = self._state(context)[4:6]
        return velocity_to(
            self._waypoints[number - 1],
            place=standing_place(schedule, self._feet(context), self._width),
            lead=pelvis - self._com(context).position[:2],
            limits=self._limits,
            params=self._params,
            stands=schedule.phase is Phase.STANDING,
        )
