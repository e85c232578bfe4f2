"""Which landings a machine survives."""

from nadia_balance.core.walking.state import Side
from nadia_balance.parameters.bounds import bounded, parameters
from nadia_balance.results.log import Log, signal_view


@parameters
class LandingLimits:
    """Largest values of a foot that meets the ground, in a recovery.

    They are ours: what an ankle's gears and a foot's force sensors bear is on
    no data sheet.
    """

    speed_along: float = bounded(
        1.0,
        above=0.0,
        most=10.0,
        of="",
        unit="m/s",
        doc="of the lowest corner of the sole, along the ground",
    )
    speed_down: float = bounded(
        0.8, above=0.0, most=10.0, of="", unit="m/s", doc="of it, downward"
    )
    mean_force: float = bounded(
        5.0,
        above=1.0,
        most=100.0,
        doc="over 10 ms, as a share of the robot's weight",
    )


def hard_landing(log: Log, limits: LandingLimits | None) -> str:
    """Finds the first touchdown that is harder than the limits.

    Args:
        log: log of a run.
        limits: largest values; None: any landing will do.

    Returns:
        What it was, in words; "" if there is none.
    """
    if limits is None or "touchdowns" not in log:
        return ""
    for row in range(len(log["touchdowns"])):
        touchdown = signal_view(log, "touchdowns", row)
        side = Side.of_sign(touchdown.side)
        for text, value, limit in (
            (
                "at {:.2f} m/s along the ground",
                touchdown.speed_along,
                limits.speed_along,
            ),
            ("at {:.2f} m/s downward", touchdown.speed_down, limits.speed_down),
            (
                "with {:.1f} times its weight",
                touchdown.mean_force,
                limits.mean_force,
            ),
        ):
            if value > limit:
                return f"hard landing: {side.value} foot {text.format(value)}"
    return ""
