"""What a system looks like: a few shapes, and where each of them is in a state. Recordings and pictures use it.

    shapes(theta)          fixed within an episode; a longer pole is drawn longer
    poses(theta, states)   position and unit quaternion (w, x, y, z) of each shape, z up; planar systems move in x and z

:func:`render` draws a planar side view without any graphics library; MuJoCo's own renderer is used for its models.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, UInt8
from tensordict import TensorDictBase
from torch import Tensor

Colour = tuple[float, float, float, float]
BLUE, RED, GREY, DARK = (
    (0.16, 0.44, 0.59, 1.0),
    (0.82, 0.29, 0.36, 1.0),
    (0.62, 0.64, 0.68, 1.0),
    (0.2, 0.22, 0.26, 1.0),
)


@dataclass(frozen=True)
class Shape:
    """One rigid part of a drawing.

    Args:
        name: unique within the system.
        kind: as of MuJoCo's geoms; a capsule lies along its own z axis.
        size: half sizes [m]: three of a box or an ellipsoid, the radius of a sphere, radius and half length of a
            capsule or a cylinder; empty for a mesh.
        colour: red, green, blue, opacity.
        moving: whether its pose changes.
        vertices: of a mesh (V, 3) [m].
        faces: of a mesh, indices of vertices (F, 3).
    """

    name: str
    kind: Literal["box", "capsule", "cylinder", "sphere", "ellipsoid", "mesh"]
    size: tuple[float, ...]
    colour: Colour
    moving: bool = True
    vertices: Float[Tensor, "V 3"] | None = None
    faces: Tensor | None = None


@runtime_checkable
class Drawable(Protocol):
    """A system that says what it looks like."""

    def shapes(self, theta: Tensor) -> tuple[Shape, ...]:
        """The shapes of a world with parameters theta (P,)."""
        ...

    def poses(self, theta: Tensor, states: TensorDictBase) -> Tensor:
        """Poses (T, S, 7) of its S shapes in states of batch size (T,)."""
        ...


def planar(x: Tensor, z: Tensor, angle: Tensor) -> Float[Tensor, "T 7"]:
    """Poses in the x-z plane; a positive angle turns a shape's top towards +x [rad]."""
    x, z, angle = torch.broadcast_tensors(x.double(), z.double(), angle.double())
    zero = torch.zeros_like(x)
    return torch.stack((x, zero, z, torch.cos(angle / 2), zero, torch.sin(angle / 2), zero), dim=-1)


def view_of(shapes: Sequence[Shape], poses: Float[Tensor, "T S 7"]) -> tuple[float, float, float, float]:
    """The rectangle (x low, x high, z low, z high) that holds every shape in every pose, with a margin [m]."""
    reach_x, reach_z = torch.tensor([_reach(shape) for shape in shapes], dtype=torch.float64).T
    x, z = poses[..., 0], poses[..., 2]
    low_x, high_x = float((x - reach_x).min()), float((x + reach_x).max())
    low_z, high_z = float((z - reach_z).min()), float((z + reach_z).max())
    margin = 0.05 * max(high_x - low_x, high_z - low_z, 1e-6)
    return low_x - margin, high_x + margin, low_z - margin, high_z + margin


def render(
    shapes: Sequence[Shape],
    poses: Float[Tensor, "S 7"],
    *,
    size: tuple[int, int] = (240, 320),
    view: tuple[float, float, float, float] | None = None,
    ghost: tuple[Sequence[Shape], Float[Tensor, "S2 7"]] | None = None,
) -> UInt8[np.ndarray, "H W 3"]:
    """A side view as pixels, seen along +y: x to the right, z up.

    Args:
        shapes, poses: what is drawn, and where.
        size: height and width [pixels].
        view: the rectangle that is shown; what holds all shapes without it.
        ghost: another system's shapes and poses, drawn pale behind.
    """
    from PIL import Image, ImageDraw  # comes with matplotlib; not needed to simulate

    view = view if view is not None else view_of(shapes, poses[None])
    height, width = size
    scale = 2 * min(width / (view[1] - view[0]), height / (view[3] - view[2]))  # twice the size, then smoothed
    shift = (width - (view[0] + view[1]) * scale / 2, height + (view[2] + view[3]) * scale / 2)
    image = Image.new("RGB", (2 * width, 2 * height), "white")
    draw = ImageDraw.Draw(image)
    for pale, (some, where) in [(True, ghost)] * (ghost is not None) + [(False, (shapes, poses))]:  # type: ignore[list-item]
        for shape, pose in zip(some, where.tolist(), strict=True):
            _draw(draw, shape, pose, scale, shift, pale)
    return np.asarray(image.resize((width, height), Image.Resampling.BOX))


def _draw(draw: object, shape: Shape, pose: list[float], scale: float, shift: tuple[float, float], pale: bool) -> None:
    """One shape's outline in the plane."""
    angle = 2 * math.atan2(pose[5], pose[3])
    mix = 0.75 if pale else 0.0
    colour = tuple(round(255 * ((1 - mix) * part + mix)) for part in shape.colour[:3])

    def at(x: float, z: float) -> tuple[float, float]:
        turned = (x * math.cos(angle) + z * math.sin(angle), z * math.cos(angle) - x * math.sin(angle))
        return shift[0] + scale * (pose[0] + turned[0]), shift[1] - scale * (pose[2] + turned[1])

    if shape.kind in ("sphere", "ellipsoid"):
        (x, z), r = at(0, 0), scale * shape.size[0]
        draw.ellipse((x - r, z - r, x + r, z + r), fill=colour)  # type: ignore[attr-defined]
    elif shape.kind == "capsule":
        r, half = shape.size
        draw.line((*at(0, -half), *at(0, half)), fill=colour, width=max(1, round(2 * scale * r)))  # type: ignore[attr-defined]
        for end in (at(0, -half), at(0, half)):
            s = scale * r
            draw.ellipse((end[0] - s, end[1] - s, end[0] + s, end[1] + s), fill=colour)  # type: ignore[attr-defined]
    elif shape.kind != "mesh":
        a, b = (shape.size[0], shape.size[2]) if shape.kind == "box" else (shape.size[0], shape.size[1])
        draw.polygon([at(-a, -b), at(a, -b), at(a, b), at(-a, b)], fill=colour)  # type: ignore[attr-defined]


def _reach(shape: Shape) -> tuple[float, float]:
    """Largest distance along x and along z of a shape's points from its centre [m]; in any pose if it moves."""
    if shape.kind == "box" and not shape.moving:
        return shape.size[0], shape.size[2]
    if shape.kind == "mesh" and shape.vertices is not None:
        far = float(shape.vertices.norm(dim=-1).max())
    else:
        far = sum(shape.size) if shape.kind == "capsule" else max(shape.size)
    return far, far
