"""Foothold adjustment on limited ground."""

import math
from dataclasses import dataclass, field

from nadia_balance.core.capture_region import CaptureRegionStepAdjusterParams
from nadia_balance.core.foothold_adjustment import (
    ROUNDING,
    Landing,
    return_to_nominal,
)
from nadia_balance.core.ground_capture import Footing, Place
from nadia_balance.core.polygon import contains, project
from nadia_balance.core.reachability import BASE, closest_point
from nadia_balance.core.walking import Adjustment, Array, FootPose

_SHARES = (1.0, 0.5, 0.25, 0.125, 0.0)  # tried shares of the margin [-]


@dataclass(frozen=True, eq=False)
class GroundLanding(Landing):
    """A landing on the reachable ground regions."""

    footing: Footing = field(kw_only=True)

    def adjust(
        self,
        current: Adjustment,
        params: CaptureRegionStepAdjusterParams,
        period: float,
    ) -> Adjustment:
        """Returns the adjustment that puts the foot on a region.

        The method is that of `adjust_foothold`, but compares the depth of the
        foothold inside the capture region instead of the shared areas.
        """
        nominal = current.nominal.pose
        if self._captures(nominal.p_WF[:2], params.margin):
            holds = not current.moved or self._captures(
                current.pose.p_WF[:2], 0.0
            )
            return return_to_nominal(current, holds, params, period)
        place, target = self._choose(current, params)
        if place is None:
            return current
        pose = current.pose
        if math.dist(target, pose.p_WF[:2]) >= params.dead_band:
            pose = self._on_ground(target, nominal)
        return Adjustment(current.nominal, pose, place.reach)

    def _foothold(self, point: Array, nominal: FootPose) -> FootPose | None:
        if any(
            contains(point, place.polygon, ROUNDING)
            for place in self.footing.places
        ):
            return self._on_ground(point, nominal)
        return None

    def _on_ground(self, point: Array, nominal: FootPose) -> FootPose:
        return self.footing.ground.pose(point, nominal.yaw, nominal.p_WF[2])

    def _captures(self, foothold: Array, margin: float) -> bool:
        """True if the foothold is reachable and captures the ICP."""
        return any(
            contains(foothold, part, ROUNDING)
            for place in self.footing.places
            if contains(foothold, place.polygon, ROUNDING)
            for part in self.footing.parts(place, self.one_step, margin)
        )

    def _choose(
        self, current: Adjustment, params: CaptureRegionStepAdjusterParams
    ) -> tuple[Place | None, Array]:
        """Returns the place of least cost, and the foothold (2,) [m] in it.

        cost = factor * distance to the nominal foothold - hysteresis, where
        factor = sqrt(area_margin) for cross-over, else 1, and hysteresis =
        distance_hysteresis for the previous place, else 0.  Candidates allow
        the largest feasible share of the margin, or the next smaller share
        (about half) for the previous place.
        """
        nominal, rules = current.nominal.pose.p_WF[:2], params.rules
        found: list[tuple[Place, Array]] = []
        for i, share in enumerate(_SHARES):
            found = self._options(nominal, share * params.margin)
            if found:
                share = _SHARES[min(i + 1, len(_SHARES) - 1)]
                found += [
                    option
                    for option in self._options(nominal, share * params.margin)
                    if self._is_last(option[0], current)
                ]
                break
        if not found:
            return self._closest(current, params)

        across = math.sqrt(rules.area_margin)

        def cost(option: tuple[Place, Array]) -> float:
            place, point = option
            factor = 1.0 if place.reach == BASE else across
            bonus = self._is_last(place, current) * rules.distance_hysteresis
            return factor * math.dist(point, nominal) - bonus

        return min(found, key=cost)

    def _options(
        self, nominal: Array, margin: float
    ) -> list[tuple[Place, Array]]:
        """Returns the closest capturing foothold of each place that has one."""
        found = []
        for place in self.footing.places:
            parts = self.footing.parts(place, self.one_step, margin)
            points = [project(nominal, part) for part in parts]
            if points:
                point = min(points, key=lambda p: math.dist(p, nominal))
                found.append((place, point))
        return found

    def _is_last(self, place: Place, current: Adjustment) -> bool:
        return (
            current.moved
            and place.reach == current.region
            and contains(current.pose.p_WF[:2], place.polygon, ROUNDING)
        )

    def _closest(
        self, current: Adjustment, params: CaptureRegionStepAdjusterParams
    ) -> tuple[Place | None, Array]:
        """Returns the place and foothold closest to the capture region."""
        last = current.pose.p_WF[:2]
        if not self.footing.places:
            return None, last

        def gap(place: Place) -> float:
            is_last = self._is_last(place, current)
            captures = self.on_arrival(
                place.polygon, params.least_time_to_land, is_last
            )
            _, gap = closest_point(place.polygon, captures)
            return gap - is_last * params.rules.distance_hysteresis

        place = min(self.footing.places, key=gap)
        return place, closest_point(place.polygon, self.capture_region)[0]
