"""Shapes of a drawing as Rerun's archetypes."""

from __future__ import annotations

from typing import Any

import torch

from onlinebayes.simulators import Shape

GHOST = (232, 135, 52, 255)


def archetype(shape: Shape, *, ghost: bool = False) -> Any:
    """Return Rerun's archetype of a shape; a ghost is a wireframe in a colour of its own, a mesh half transparent."""
    import rerun as rr

    fill = rr.components.FillMode.MajorWireframe if ghost else rr.components.FillMode.Solid
    colour = GHOST if ghost else tuple(round(255 * part) for part in shape.colour)
    style: dict[str, Any] = {"colors": [colour], "fill_mode": fill}
    match shape.kind:
        case "box" | "plane":
            return rr.Boxes3D(half_sizes=[shape.size], **style)
        case "sphere":
            return rr.Ellipsoids3D(half_sizes=[[shape.size[0]] * 3], **style)
        case "ellipsoid":
            return rr.Ellipsoids3D(half_sizes=[shape.size], **style)
        case "cylinder":
            return rr.Cylinders3D(lengths=[2 * shape.size[1]], radii=[shape.size[0]], **style)
        case "capsule":  # Rerun's begins at its origin, ours is centred
            start = [[0.0, 0.0, -shape.size[1]]]
            return rr.Capsules3D(lengths=[2 * shape.size[1]], radii=[shape.size[0]], translations=start, **style)
    assert shape.vertices is not None
    faces = None if shape.faces is None else shape.faces.numpy()
    albedo = (*GHOST[:3], 110) if ghost else colour
    return rr.Mesh3D(vertex_positions=shape.vertices.numpy(), triangle_indices=faces, albedo_factor=albedo)


def alike(one: Shape | None, other: Shape) -> bool:
    """Check whether two shapes look the same."""
    if one is None or (one.kind, one.size, one.colour) != (other.kind, other.size, other.colour):
        return False
    return all(
        a is b or (a is not None and b is not None and torch.equal(a, b))
        for a, b in ((one.vertices, other.vertices), (one.faces, other.faces))
    )
