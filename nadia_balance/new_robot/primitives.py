"""Triangle meshes of the primitive shapes of a URDF."""

import math
from collections.abc import Mapping

import trimesh


def primitive_mesh(
    kind: str, size: Mapping[str, str], where: str
) -> trimesh.Trimesh | None:
    """Returns the primitive in its own frame; None for an unknown `kind`.

    Raises:
        ValueError: a length is not > 0 m.
    """

    def lengths(name: str) -> list[float]:
        text = size.get(name, "")
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        if not values or not all(0.0 < v < math.inf for v in values):
            raise ValueError(f"{where}: {name} = {text!r}: must be > 0 m")
        return values

    make = trimesh.creation
    if kind == "box":
        return make.box(lengths("size"))
    if kind == "sphere":
        return make.icosphere(3, *lengths("radius"))
    if kind in ("cylinder", "capsule"):
        (height,), (radius,) = lengths("length"), lengths("radius")
        return getattr(make, kind)(height=height, radius=radius)
    if kind == "ellipsoid":
        mesh = make.icosphere(3, 1.0)
        return mesh.apply_scale([lengths(half_axis)[0] for half_axis in "abc"])
    return None
