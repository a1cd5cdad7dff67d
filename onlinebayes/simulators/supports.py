"""The farthest points of convex shapes, and turns by quaternions.

p(d) = argmax over the points x of a shape of d . x,     in closed form but for meshes
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from onlinebayes.simulators.drawing import Shape


def support(
    shape: Shape, poses: Float[np.ndarray, "T 7"], directions: Float[np.ndarray, "K 3"]
) -> Float[np.ndarray, "T K 3"]:
    """The farthest points of a shape in each of the directions."""
    turned = rotation(poses[:, 3:])
    d = directions @ turned
    size = np.array(shape.size)
    if shape.kind == "mesh":
        assert shape.vertices is not None
        vertices = shape.vertices.double().numpy()
        own = vertices[np.argmax(d @ vertices.T, axis=-1)]
    elif shape.kind in ("box", "plane"):
        own = np.sign(d) * size
    elif shape.kind == "ellipsoid":
        own = d * size**2 / np.linalg.norm(d * size, axis=-1, keepdims=True)
    elif shape.kind == "cylinder":
        radial = d * [1, 1, 0]
        length = np.maximum(np.linalg.norm(radial, axis=-1, keepdims=True), 1e-12)
        own = size[0] * radial / length + np.sign(d) * [0, 0, size[1]]
    else:
        own = size[0] * d + (np.sign(d) * [0, 0, size[1]] if shape.kind == "capsule" else 0)
    return own @ turned.swapaxes(-1, -2) + poses[:, None, :3]


def rotation(quaternion: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 3 3"]:
    """The turn of a unit quaternion (w, x, y, z)."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)
