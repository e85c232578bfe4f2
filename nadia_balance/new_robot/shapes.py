"""The shapes of links, with their triangle meshes."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix

Array = NDArray[np.float64]
VISUAL, COLLIDING = "visual", "collision"
# Attributes of the tags of a URDF.
SOLIDS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "ellipsoid": ("a", "b", "c"),
    "mesh": ("filename",),
}
Z_UP = RigidTransform(RotationMatrix.MakeXRotation(0.5 * np.pi))  # from y up


@dataclass
class Shape:
    """A shape with the pose X_LG in its link; a mesh may be `given`."""

    role: str  # VISUAL or COLLIDING
    kind: str  # its tag in a URDF, of SOLIDS
    size: Mapping[str, str]  # attributes of that tag
    X_LG: RigidTransform
    colour: str = ""  # "r g b a"
    given: trimesh.Trimesh | None = None  # in G

    @property
    def mesh(self) -> trimesh.Trimesh:
        """Its triangle mesh in its own frame G; raises as `triangles`."""
        if self.given is not None:
            return self.given
        return triangles(self.kind, tuple(sorted(self.size.items())))

    @property
    def y_up(self) -> bool:
        """True if it is a Collada file that says that y is up."""
        path = Path(self.size.get("filename", ""))
        if path.suffix.lower() != ".dae":
            return False
        with path.open("rb") as file:
            return b"<up_axis>Y_UP" in file.read(8192)

    def points(self) -> Array:
        """Vertices (k, 3) in the frame of the link."""
        return (self.X_LG @ np.asarray(self.mesh.vertices).T).T


@cache
def triangles(kind: str, size: tuple[tuple[str, str], ...]) -> trimesh.Trimesh:
    """Returns the mesh of a solid with the attributes `size`, in its frame.

    Raises:
        ValueError: the file of a mesh is empty, or cannot be read.
    """
    make, given = trimesh.creation, dict(size)
    path = given.pop("filename", "")
    number = {k: np.array(text.split(), float) for k, text in given.items()}
    match kind:
        case "box":
            return make.box(number["size"])
        case "sphere":
            return make.icosphere(3, number["radius"].item())
        case "cylinder" | "capsule":
            radius, length = number["radius"].item(), number["length"].item()
            return getattr(make, kind)(radius=radius, height=length)
        case "ellipsoid":
            axes = np.concatenate([number[axis] for axis in "abc"])
            return make.icosphere(3, 1.0).apply_scale(axes)
    try:
        mesh = trimesh.load(path, force="mesh", skip_materials=True)
    except Exception:  # trimesh's readers raise any class
        mesh = trimesh.Trimesh()
    if not len(mesh.vertices):
        raise ValueError(f"{path}: must be a whole STL, OBJ or Collada file")
    return mesh.apply_scale(number.get("scale", np.ones(3)))
