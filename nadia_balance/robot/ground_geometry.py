"""The ground in a MultibodyPlant, its friction, and the plant's settings."""

import numpy as np
from pydrake.geometry import Convex, RoleAssign, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody import plant as mbp
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import BodyIndex

from nadia_balance import palette
from nadia_balance.core.body.ground import Ground
from nadia_balance.robot.params import MODELS

_ROUGH = mbp.CoulombFriction(0.8, 0.8)  # as in flat.urdf
_DEPTH = 0.5  # depth of the ground below its lowest point [m]


def default_plant_config(time_step: float = 0.001) -> MultibodyPlantConfig:
    """Point contact at 1 kHz: the fastest that is accurate enough."""
    return MultibodyPlantConfig(
        time_step=time_step,
        contact_model="point",
        discrete_contact_approximation="sap",
        use_sampled_output_ports=False,
    )


def add_ground(plant: MultibodyPlant, ground: Ground | None = None) -> None:
    """Adds the ground to a `plant` that is not finalized yet.

    The ground is flat, z = 0, unless `ground` is uneven: then each of its
    regions is the visible top of a rigid prism with the same friction.
    """
    if ground is None or ground.is_level:
        Parser(plant).AddModels(str(MODELS / "terrain" / "flat.urdf"))
        return
    tops = [
        np.column_stack([r.polygon, r.heights(r.polygon)])
        for r in ground.regions
    ]
    bottom = min(top[:, 2].min() for top in tops) - _DEPTH
    for i, top in enumerate(tops):
        below = top * [1.0, 1.0, 0.0] + [0.0, 0.0, bottom]
        shape = Convex(np.vstack([top, below]).T, name := f"region {i}")
        where = plant.world_body(), RigidTransform(), shape, name
        plant.RegisterCollisionGeometry(*where, _ROUGH)
        plant.RegisterVisualGeometry(*where, palette.rgba(palette.GROUND).rgba)


def scale_friction(
    plant: MultibodyPlant, scene_graph: SceneGraph, ratio: float
) -> None:
    """Multiplies all friction coefficients in a finalized `plant`."""
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    replaces = RoleAssign.kReplace
    for i in range(plant.num_bodies()):
        body = plant.get_body(BodyIndex(i))
        for shape in plant.GetCollisionGeometriesForBody(body):
            properties = inspector.GetProximityProperties(shape)
            mu = properties.GetProperty("material", "coulomb_friction")
            values = ratio * mu.static_friction(), ratio * mu.dynamic_friction()
            mu = mbp.CoulombFriction(*values)
            properties.UpdateProperty("material", "coulomb_friction", mu)
            scene_graph.AssignRole(source, shape, properties, replaces)
