"""Meshcat parts of a closed loop: controls, drawings and mouse pushes."""

from collections.abc import Sequence

from pydrake.geometry import Meshcat, SceneGraph
from pydrake.lcm import DrakeLcm
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForceMultiplexer,
    MultibodyPlant,
)
from pydrake.systems.framework import DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import ConstantVectorSource
from pydrake.visualization import ApplyVisualizationConfig, VisualizationConfig

from nadia_balance.core.mechanisms import Mechanisms
from nadia_balance.systems.balance_visualizer import BalanceVisualizer
from nadia_balance.systems.live_controls import LiveControls
from nadia_balance.systems.ports import connect
from nadia_balance.systems.push_source import PushSource

CONTROLS = "live_controls"  # name of the LiveControls system


def add_mechanisms(
    builder: DiagramBuilder,
    on: Mechanisms,
    push: PushSource,
    meshcat: Meshcat | None,
) -> OutputPort:
    """Adds the source of `mechanisms`: constant, or LiveControls."""
    if meshcat is None:
        return builder.AddNamedSystem(
            "mechanisms", ConstantVectorSource(on.as_vector())
        ).get_output_port()
    controls = builder.AddNamedSystem(CONTROLS, LiveControls(meshcat, on))
    connect(builder, controls, push, "live_push")
    return controls.GetOutputPort("mechanisms")


def add_drawings(
    builder: DiagramBuilder,
    view: BalanceVisualizer,
    sources: Sequence[tuple[System, Sequence[str]]],
) -> None:
    """Adds `view` and connects it to the signals that the `sources` have."""
    builder.AddNamedSystem("balance_visualizer", view)
    for system, names in sources:
        connect(builder, system, view, *filter(system.HasOutputPort, names))


def add_mouse(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    meshcat: Meshcat,
) -> OutputPort | None:
    """Adds Drake's pushes with the mouse, which exist from Drake 1.57 on.

    Returns the output port of their forces, not connected; None in an older
    Drake.
    """
    if not hasattr(VisualizationConfig, "mouse_interaction_stiffness"):
        return None
    config = VisualizationConfig(
        publish_illustration=False,
        publish_proximity=False,
        publish_inertia=False,
        publish_contacts=False,
    )
    ApplyVisualizationConfig(
        config,
        builder,
        plant=plant,
        scene_graph=scene_graph,
        meshcat=meshcat,
        lcm=DrakeLcm("memq://null"),
    )
    applied = plant.GetInputPort("applied_spatial_force")
    spring, index = builder.connection_map()[plant, applied.get_index()]
    forces = spring.get_output_port(index)
    builder.Disconnect(forces, applied)
    return forces


def connect_forces(
    builder: DiagramBuilder, engine: System, *forces: OutputPort | None
) -> None:
    """Applies the sum of the `forces` that are not None to the `engine`."""
    ports = [port for port in forces if port is not None]
    source = ports[0]
    if len(ports) > 1:
        both = builder.AddSystem(
            ExternallyAppliedSpatialForceMultiplexer(len(ports))
        )
        for i, port in enumerate(ports):
            builder.Connect(port, both.get_input_port(i))
        source = both.get_output_port()
    builder.Connect(source, engine.GetInputPort("applied_spatial_force"))
