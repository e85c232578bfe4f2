"""The signals between blocks, and the wiring of blocks by their names.

A signal has the name of its port.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from pydrake.common.containers import namedview
from pydrake.systems import framework

from nadia_balance.core.math.qp import QpResult
from nadia_balance.core.plan.icp_plan import IcpPlan
from nadia_balance.core.steps.foothold_adjustment import CaptureRegions
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.state import Mode, Phase, Side
from nadia_balance.core.whole_body.command import WholeBodyTerms

PHASES = (Phase.STANDING, Phase.TRANSFER, Phase.SWING)
MODES = (Mode.STANDING, Mode.WALKING, Mode.RECOVERING)
_ICP = "icp_x icp_y icp_velocity_x icp_velocity_y cop_x cop_y ecmp_x ecmp_y"
_ECMP = "cop_x cop_y ecmp_x ecmp_y"
_MOTION = "x y z vx vy vz ax ay az yaw yaw_rate yaw_acceleration"
_STATUS = "solved fallback solves violation failures"
_WALKING = """phase support_side time_in_phase duration waiting steps_taken
    left_x left_y left_yaw right_x right_y right_yaw
    target_x target_y target_yaw target_side mode"""
_PUSH = "number delta_v force_x force_y force_z waiting"
_PARTS = itertools.product(Side, ("x", "y", "z", "yaw"))


def entries(first: int, last: int) -> property:
    """The entries `first` to `last` - 1 of a namedview, as one vector."""
    return property(lambda view: view[first:last])


def is_vector(kind: int | type) -> bool:
    """True for a size or a namedview, False for another type."""
    return isinstance(kind, int) or hasattr(kind, "get_fields")


def size(kind: int | type) -> int:
    """The number of entries of a namedview; a size itself."""
    return kind if isinstance(kind, int) else len(kind.get_fields())


class ComState(namedview("ComState", ["x", "y", "z", "vx", "vy", "vz"])):
    """Position and velocity of the centre of mass, (3,) in W [m], [m/s]."""

    position, velocity = entries(0, 3), entries(3, 6)


class IcpReference(namedview("IcpReference", _ICP.split())):
    """The ICP plan at the present time, xy in W [m], [m/s]."""

    icp, icp_velocity = entries(0, 2), entries(2, 4)
    cop, ecmp = entries(4, 6), entries(6, 8)


class EcmpCommand(namedview("EcmpCommand", _ECMP.split())):
    """The commanded CoP and eCMP, xy in W [m]."""

    cop, ecmp = entries(0, 2), entries(2, 4)


class QpStatus(namedview("QpStatus", _STATUS.split())):
    """Status of a QP in this tick, with the number of failures until now.

    `violation` is the largest constraint violation, in units of the QP's rows.
    """

    def after(self, qp: QpResult) -> tuple[float, ...]:
        """The next status, after the result `qp`."""
        failures = self.failures + (not qp.solved)
        return qp.solved, qp.fallback, qp.solves, qp.violation, failures


class SwingFootReference(namedview("SwingFootReference", _MOTION.split())):
    """The motion of a sole in W (see `as_reference`): [m], [rad], [s]."""

    position, velocity = entries(0, 3), entries(3, 6)
    acceleration = entries(6, 9)


class WalkingSignal(namedview("WalkingSignal", _WALKING.split())):
    """The walking state as numbers, for logs.

    `phase` is an index of PHASES, `mode` of MODES; `support_side` and
    `target_side` are +1 for left, -1 for right; `time_in_phase` and `duration`
    [s]; `left` and `right` are the present or last stance poses, `target` is
    the next foothold (NaN, and side 0, without one), each (x, y, yaw) in W [m],
    [rad].
    """

    left, right, target = entries(6, 9), entries(9, 12), entries(12, 15)


class PushSignal(namedview("PushSignal", _PUSH.split())):
    """The push that acts now: `delta_v` [m/s] and force in W [N].

    `number` counts from 1 on, live pushes after scripted ones; of several, the
    one that began last; 0: no push.  `waiting` scripted ones have not ended.
    """

    force = entries(2, 5)


class VelocityCommand(
    namedview("VelocityCommand", ["forward", "left", "turn"])
):
    """In the level frame between the feet [m/s], [rad/s]; 0 is to stand."""


FootForces = namedview("FootForces", [side.value for side in Side])


class MeasuredFeet(
    namedview("MeasuredFeet", [f"{s.value}_{part}" for s, part in _PARTS])
):
    """The measured soles: their centres p_WF [m], and yaw [rad]."""

    left, right = entries(0, 3), entries(4, 7)


# Angles of torso and pelvis against the vertical [rad].
TrunkTilt = namedview("TrunkTilt", ["torso", "pelvis"])

# What blocks tell each other, by the names of the ports: the size of a vector,
# its namedview, or the type of a Python value.  Points and forces are in W, and
# left comes before right.  Those of the size of a robot are not here.
SIGNALS: dict[str, int | type] = {
    "adjustment": walking.Adjustment,  # None while `step` is off
    "alip_icp": 2,  # the icp with the momentum about the contact [m]
    "capture_regions": CaptureRegions,
    "com_state": ComState,
    "ecmp_command": EcmpCommand,
    "foot_forces": 2,  # vertical forces on the feet [N]
    "footsteps": tuple,  # of Footstep, after the present phase; () to stand
    "foot_poses": walking.FootPoses,  # measured
    "foot_wrenches": 12,  # [tau, f] on each sole, at its centre [N m, N]
    "friction": 1,  # coefficient of the friction pyramid [-]
    "icp": 2,  # measured [m]
    "icp_plan": IcpPlan,  # of the schedule of `walking_state`
    "icp_reference": IcpReference,
    "live_push": 4,  # count, delta_v [m/s], direction [deg], duration [s]
    "mechanisms": 4,  # see Mechanisms; all on if not connected
    "momentum_qp_status": QpStatus,  # its violation in [m]
    "momentum_rate": 3,  # of the linear momentum [N]
    "push_force": 3,  # sum of all pushes [N]
    "push_signal": PushSignal,
    # Steps not landed, the one in the air too; None: as they are.
    "revised_footsteps": tuple,
    "swing_foot_reference": SwingFootReference,
    "time_adjustment": 2,  # see TimeAdjustment [s]; 0 if not connected
    # Forward, left [m/s], turn to the left [rad/s]; 0 if not connected.
    "velocity_command": 3,
    "walking_signal": WalkingSignal,
    "walking_state": walking.WalkingState,
    "whole_body_qp_status": QpStatus,
    "whole_body_terms": WholeBodyTerms,
}


def sizes(names: str) -> dict[str, int]:
    """The sizes of the vector signals `names`, by name."""
    return {name: size(SIGNALS[name]) for name in names.split()}


def fill(
    makers: Mapping[str, Callable[[], framework.System]],
    outputs: Mapping[str, str],
    blocks: Mapping[str, framework.System | None],
    others: Iterable[str] = (),
) -> dict[str, framework.System]:
    """Returns a system for each role: that in `blocks`, or of its maker.

    None in `blocks` leaves the role empty.  `outputs` are the names of the
    ports that a role must have; `others` are roles elsewhere, for the message.

    Raises ValueError: `blocks` has an unknown role, no System, or a system that
    lacks an output of its role.
    """
    for role, block in blocks.items():
        if role not in makers:
            known = ", ".join((*makers, *others))
            raise ValueError(f"block = {role!r}: must be one of {known}")
        if block is None:
            continue
        if not isinstance(block, framework.System):
            raise ValueError(
                f"{role} = {block!r}: must be a System, made already"
            )
        for name in outputs[role].split():
            if not block.HasOutputPort(name):
                raise ValueError(
                    f"{role} = {type(block).__name__}: must have the output "
                    f"port {name!r}"
                )
    found = {
        role: blocks[role] if role in blocks else make()
        for role, make in makers.items()
    }
    return {role: block for role, block in found.items() if block is not None}


def connect(
    builder: framework.DiagramBuilder,
    source: framework.System,
    sink: framework.System,
    *names: str,
    **renamed: str,
) -> None:
    """Connects the ports of these names from `source` to `sink`.

    Ports of different names: `connect(..., name_at_source="name_at_sink")`.
    """
    for name, other in [*zip(names, names, strict=True), *renamed.items()]:
        builder.Connect(source.GetOutputPort(name), sink.GetInputPort(other))


def read(port: framework.OutputPort, root: framework.Context) -> Any:
    """Returns the value of a block's `port` in the Context `root` of all."""
    return port.Eval(port.get_system().GetMyContextFromRoot(root))


def wire(
    builder: framework.DiagramBuilder,
    blocks: Mapping[str, framework.System],
    inputs: Iterable[str],
) -> None:
    """Adds `blocks`, connects ports of equal names and exports the others.

    A signal has the same name everywhere: each input port is connected to the
    output port of its name, or to the diagram's, which must be one of `inputs`.
    All outputs become outputs of the diagram.

    Raises ValueError: an input without a source, an output of two blocks, or
    ports of one name and different types; names block and port.
    """
    sources = {}
    for role, block in blocks.items():
        builder.AddNamedSystem(role, block)
        for port in map(block.get_output_port, range(block.num_output_ports())):
            if (name := port.get_name()) in sources:
                raise ValueError(
                    f"{role} = {type(block).__name__}: must not have the "
                    f"output port {name!r}, another block has it"
                )
            sources[name] = port
            builder.ExportOutput(port, name)
    exported = set()
    for role, block in blocks.items():
        for port in map(block.get_input_port, range(block.num_input_ports())):
            name, of = port.get_name(), f"{role} = {type(block).__name__}"
            what = f"{of}: input port {name!r} must be "
            if source := sources.get(name):
                if (found := _kind(port)) != (needed := _kind(source)):
                    other = source.get_system().get_name()
                    raise ValueError(
                        f"{what}{needed}, as {other}'s output; it is {found}"
                    )
                builder.Connect(source, port)
            elif name not in inputs:
                known = ", ".join(sorted({*sources, *inputs}))
                raise ValueError(f"{what}one of {known}")
            elif name in exported:
                builder.ConnectInput(name, port)
            else:
                builder.ExportInput(port, name)
                exported.add(name)


def _kind(port: framework.InputPort | framework.OutputPort) -> str:
    if port.get_data_type() == framework.PortDataType.kAbstractValued:
        return "abstract"
    return f"a vector of {port.size()}"
