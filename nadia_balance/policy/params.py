"""The contract of a policy: what its network was trained with."""

from nadia_balance.parameters.bounds import bounded, parameters, require
from nadia_balance.policy.observation import TERMS, term_size


@parameters
class ObservationTerm:
    """A part of the observation."""

    name: str = bounded("", one_of=tuple(TERMS), doc="what is measured")
    scale: list[float] = bounded(
        lambda: [1.0], doc="factors: one, or one for each entry"
    )
    clip: list[float] = bounded(
        list, doc="least and largest entry, before the scale; none: any"
    )
    history: int = bounded(
        1, least=1, most=1000, doc="ticks that the network is told"
    )


@parameters
class PolicyParams:
    """What a policy was trained with.

    The network's n actions a are joint targets q_d, which springs hold, n
    torques clipped at the effort limits:

        q_d = q_a + s a,    tau = K_p (q_d - q) - K_d v
    """

    joints: list[str] = bounded(
        list, doc="names of the n joints, in the order of the policy"
    )
    stiffness: list[float] = bounded(
        list, least=0.0, doc="K_p of each joint, in N m/rad"
    )
    damping: list[float] = bounded(
        list, least=0.0, doc="K_d of each joint, in N m s/rad"
    )
    default_angles: dict[str, float] = bounded(
        dict,
        doc="q_0 by joint, in rad: the observation's angles are q - q_0; of "
        "joints that are not named 0",
    )
    action_offset: dict[str, float] | None = bounded(
        None, doc="q_a by joint, in rad; by default q_0"
    )
    action_scale: list[float] = bounded(
        lambda: [0.25], doc="s, in rad: one, or one for each joint"
    )
    action_limit: float = bounded(
        100.0, above=0.0, doc="largest entry of an action"
    )
    target_limits: list[list[float]] = bounded(
        list, doc="least and largest q_d of each joint, in rad; none: any"
    )
    period: float = bounded(
        0.02, above=0.0, unit="s", doc="time from action to action"
    )
    stride: float = bounded(
        1.0, above=0.0, unit="s", doc="duration of two steps, of the phases"
    )
    command_limits: list[list[float]] = bounded(
        list,
        doc="least and largest command: forward, left, in m/s, and turn, in "
        "rad/s; none: any",
    )
    observation: list[ObservationTerm] = bounded(
        list, doc="the terms, in the order of the network"
    )
    by_tick: bool = bounded(
        False,
        doc="the history tick by tick, each with all terms; otherwise term by "
        "term",
    )

    def validate_more(self) -> None:
        """Checks names and lengths.

        Raises:
            ValueError: names field, value and what is allowed.
        """
        n = len(self.joints)
        require(n > 0, "joints = []: must name the joints of the policy")
        require(
            len({*self.joints}) == n,
            f"joints = {', '.join(self.joints)}: must have each joint once",
        )
        for name in ("stiffness", "damping"):
            _require_length(name, getattr(self, name), (n,))
        _require_length("action_scale", self.action_scale, (1, n))
        _require_ranges("target_limits", self.target_limits, n)
        _require_ranges("command_limits", self.command_limits, 3)
        for name in ("default_angles", "action_offset"):
            for joint in getattr(self, name) or {}:
                require(
                    joint in self.joints,
                    f"{name}.{joint}: must be a joint of the policy",
                )
        require(len(self.observation) > 0, "observation = []: must have terms")
        for i, term in enumerate(self.observation):
            self._check_term(term, f"observation[{i}]")

    def _check_term(self, term: ObservationTerm, path: str) -> None:
        size = term_size(term.name, len(self.joints))
        _require_length(f"{path}.scale", term.scale, (1, size))
        if term.clip:
            _require_ranges(f"{path}.clip", [term.clip], 1)
        first = self.observation[0].history
        require(
            not self.by_tick or term.history == first,
            f"{path}.history = {term.history}: must be {first}, as of the "
            "first term, by_tick",
        )


def _require_length(
    name: str, values: list[float], allowed: tuple[int, ...]
) -> None:
    lengths = " or ".join(map(str, sorted({*allowed})))
    require(
        len(values) in allowed,
        f"{name} = {len(values)} values: must be {lengths}",
    )


def _require_ranges(name: str, ranges: list[list[float]], count: int) -> None:
    require(
        len(ranges) in (0, count),
        f"{name} = {len(ranges)} pairs: must be {count}",
    )
    for i, pair in enumerate(ranges):
        require(
            len(pair) == 2 and pair[0] <= pair[1],
            f"{name}[{i}] = {pair}: must be the least and the largest value",
        )
