"""Boxes on the ground, for tests of contacts."""

from pydrake.geometry import AddContactMaterial, Box, ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder


def properties() -> ProximityProperties:
    found = ProximityProperties()
    AddContactMaterial(
        properties=found, dissipation=10.0, friction=CoulombFriction(0.8, 0.8)
    )
    return found


def ground(builder: DiagramBuilder) -> MultibodyPlant:
    """A plant with a time step of 1 ms that is flat, and empty."""
    config = MultibodyPlantConfig(time_step=0.001, contact_model="point")
    plant, _ = AddMultibodyPlant(config, builder)
    register(plant, plant.world_body(), Box(4.0, 4.0, 1.0), [0.0, 0.0, -0.5])
    return plant


def register(plant: MultibodyPlant, body, shape, at=(0.0, 0.0, 0.0)) -> None:
    """Gives the body a shape that touches others, at p_BG (3,) or X_BG."""
    count = len(plant.GetCollisionGeometriesForBody(body))
    plant.RegisterCollisionGeometry(
        body, RigidTransform(at), shape, f"{count}", properties()
    )


def cube(plant: MultibodyPlant, name: str, model, mass: float, size: float, at):
    """A new body of the model: a cube [m], [kg] that begins at p_WB (3,)."""
    inertia = SpatialInertia.SolidBoxWithMass(mass, size, size, size)
    body = plant.AddRigidBody(name, model, inertia)
    register(plant, body, Box(size, size, size))
    plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform(at))
    return body
