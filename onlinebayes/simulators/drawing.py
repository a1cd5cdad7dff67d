"""The appearance of a system: a few shapes, and the pose of each in a state. Recordings and pictures use it.

    shapes(theta)          fixed within an episode; a longer pole is drawn longer
    poses(theta, states)   position and unit quaternion (w, x, y, z) of each shape, z up; planar systems move in x and z

:func:`render` draws them without any graphics library. A convex body seen along d shows the points

    p(u) = argmax over its points x of u . x,     u the unit vectors perpendicular to d

which are known in closed form for boxes, ellipsoids, capsules and cylinders (their support functions).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.simulators.supports import rotation, support

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

Kind = Literal["box", "capsule", "cylinder", "sphere", "ellipsoid", "plane", "mesh"]
Colour = tuple[float, float, float, float]
BLUE, RED, GREY, DARK = (
    (0.16, 0.44, 0.59, 1.0),
    (0.82, 0.29, 0.36, 1.0),
    (0.62, 0.64, 0.68, 1.0),
    (0.2, 0.22, 0.26, 1.0),
)
SIDE, OBLIQUE = (0.0, 0.0), (25.0, 20.0)
"""Directions to look in [degrees]: azimuth, from behind +x towards the viewer, and elevation."""
DIRECTIONS = 64  # points of an outline
SMOOTH = 3  # a picture is drawn so much larger first
TOUCHING = 0.05  # of the smaller extent: what overlaps by less is taken for parted
ALONG = 0.05  # a plane that the view runs along tells nothing: least cosine
PALE = 0.75  # how far a ghost's colours are on their way to white
LIGHT = np.array([-0.3, -0.7, 0.65]) / math.sqrt(0.3**2 + 0.7**2 + 0.65**2)


@dataclass(frozen=True)
class Shape:
    """One rigid part of a drawing.

    Args:
        name: unique within the system.
        kind: as of MuJoCo's geoms; a capsule and a cylinder lie along their own z axis. A plane is a ground: a flat
            box that may end outside of the picture.
        size: half sizes [m]: three of a box, a plane or an ellipsoid, the radius of a sphere, radius and half length of
            a capsule or a cylinder; empty for a mesh.
        colour: red, green, blue, opacity.
        moving: whether its pose changes.
        vertices: of a mesh (V, 3) [m].
        faces: of a mesh, indices of vertices (F, 3), anticlockwise from outside.
    """

    name: str
    kind: Kind
    size: tuple[float, ...]
    colour: Colour
    moving: bool = True
    vertices: Float[Tensor, "V 3"] | None = None
    faces: Int[Tensor, "F 3"] | None = None


@runtime_checkable
class Drawable(Protocol):
    """A system that says what it looks like; a task may do so too, and show its goal."""

    def shapes(self, theta: Tensor) -> tuple[Shape, ...]:
        """The shapes of a world with parameters theta (P,)."""
        ...

    def poses(self, theta: Tensor, states: TensorDictBase) -> Tensor:
        """Poses (T, S, 7) of its S shapes in states of batch size (T,)."""
        ...


@dataclass(frozen=True)
class View:
    """The rectangle that a picture shows, and the direction of view.

    Args:
        low, high: corners of the rectangle, right and up in the picture [m].
        turn: direction to look in, azimuth and elevation [degrees].
    """

    low: tuple[float, float]
    high: tuple[float, float]
    turn: tuple[float, float] = SIDE

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Rows: right, up, and away from the viewer, in the world."""
        a, e = math.radians(self.turn[0]), math.radians(self.turn[1])
        return np.array(
            [
                [math.cos(a), math.sin(a), 0.0],
                [-math.sin(a) * math.sin(e), math.cos(a) * math.sin(e), math.cos(e)],
                [-math.sin(a) * math.cos(e), math.cos(a) * math.cos(e), -math.sin(e)],
            ]
        )


def planar(x: Tensor, z: Tensor, angle: Tensor, y: float = 0.0) -> Float[Tensor, "T 7"]:
    """Poses in the x-z plane; a positive angle turns a top towards +x [rad], what has a smaller y is in front."""
    x, z, angle = torch.broadcast_tensors(x.double(), z.double(), angle.double())
    zero = torch.zeros_like(x)
    return torch.stack((x, zero + y, z, torch.cos(angle / 2), zero, torch.sin(angle / 2), zero), dim=-1)


def scene(
    systems: Sequence[object], theta: Float[Tensor, " P"], states: TensorDictBase
) -> tuple[tuple[Shape, ...], Float[Tensor, "T S 7"]]:
    """Shapes and poses of those among the systems that can be drawn, e.g. of a simulator and a task with a goal.

    Poses lie on the CPU, where pictures are made.
    """
    drawn = [system for system in systems if isinstance(system, Drawable)]
    shapes = tuple(shape for system in drawn for shape in system.shapes(theta))
    poses = [system.poses(theta, states).double().cpu() for system in drawn]
    return shapes, torch.cat(poses, dim=1) if poses else torch.zeros(*states.batch_size, 0, 7, dtype=torch.float64)


def view_of(shapes: Sequence[Shape], poses: Float[Tensor, "T S 7"], turn: tuple[float, float] | None = None) -> View:
    """The view that holds every shape in every pose, with a margin; of planes nothing.

    Without ``turn`` a motion that stays in one plane is seen from the side, any other from above and aside.
    """
    places = poses.numpy()
    if turn is None:
        across = np.ptp(places[..., 1], axis=0).max(initial=0)
        turn = OBLIQUE if across > 0.01 * np.abs(places[..., :3]).max(initial=0) else SIDE
    axes = View((0, 0), (0, 0), turn).axes
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for i, shape in enumerate(shapes):
        if shape.kind == "plane":
            continue
        ends = support(shape, places[:, i], np.concatenate([axes[:2], -axes[:2]]))
        seen = (ends @ axes[:2].T).reshape(-1, 2)
        low, high = np.minimum(low, seen.min(0)), np.maximum(high, seen.max(0))
    if not np.isfinite(low).all():
        low, high = -np.ones(2), np.ones(2)
    margin = 0.05 * max(*(high - low), 1e-6)
    (left, bottom), (right, top) = (low - margin).tolist(), (high + margin).tolist()
    return View((left, bottom), (right, top), turn)


def render(
    shapes: Sequence[Shape],
    poses: Float[Tensor, "S 7"],
    *,
    size: tuple[int, int] = (240, 320),
    view: View | None = None,
    ghost: tuple[Sequence[Shape], Float[Tensor, "S2 7"]] | None = None,
) -> UInt8[np.ndarray, "H W 3"]:
    """A picture in parallel projection.

    Args:
        shapes, poses: what is drawn, and where.
        size: height and width [pixels].
        view: what is shown; without it what holds all shapes, from the side: x to the right, z up.
        ghost: another system's shapes and poses, drawn pale behind.
    """
    from PIL import Image, ImageDraw  # comes with matplotlib; not needed to simulate

    view = view if view is not None else view_of(shapes, poses[None])
    large = np.array([size[1], size[0]]) * SMOOTH
    middle, extent = (np.array(view.low) + view.high) / 2, np.array(view.high) - view.low
    scale = float((large / extent).min())
    image = Image.new("RGB", (int(large[0]), int(large[1])), "white")
    draw = ImageDraw.Draw(image)
    for some, where, mix in ([(*ghost, PALE)] if ghost is not None else []) + [(shapes, poses, 0.0)]:
        places = where.double().numpy()
        for i in _back_to_front(some, places, view):
            for points, colour, edge in _patches(some[i], places[i], view):
                pixels = large / 2 + (points - middle) * [scale, -scale]
                _polygon(draw, pixels, _shade(colour, mix), _shade(edge, mix) if edge else None)
    return np.asarray(image.reduce(SMOOTH))


def captioned(picture: UInt8[np.ndarray, "H W 3"], words: str) -> UInt8[np.ndarray, "H W 3"]:
    """The picture with a few words in its upper left corner."""
    from PIL import Image, ImageDraw

    image = Image.fromarray(picture)
    ImageDraw.Draw(image).text((4, 2), words, fill=(91, 98, 109))
    return np.asarray(image)


def render_state(
    systems: Sequence[object],
    theta: Float[Tensor, " P"],
    state: TensorDictBase,
    *,
    size: tuple[int, int] = (240, 320),
    view: View | None = None,
) -> UInt8[np.ndarray, "H W 3"]:
    """A picture of one state, of no batch size; see :func:`scene` and :func:`render`."""
    shapes, poses = scene(systems, theta, state.unsqueeze(0))
    return render(shapes, poses[0], size=size, view=view)


def _back_to_front(shapes: Sequence[Shape], places: Float[np.ndarray, "S 7"], view: View) -> list[int]:
    """The painter's order: two shapes that a plane parts are drawn on their sides of it, others by their centres.

    The planes lie across the world's axes and across the direction of view. So a cup is drawn after the table that it
    stands on, however large the table is.
    """
    if not shapes:
        return []
    across = np.concatenate([np.eye(3), view.axes[2:]])
    away = across @ view.axes[2]
    ends = [support(shape, places[i : i + 1], np.concatenate([across, -across]))[0] for i, shape in enumerate(shapes)]
    high = np.array([(end[:4] * across).sum(1) for end in ends])
    low = np.array([(end[4:] * across).sum(1) for end in ends])
    touching = TOUCHING * np.minimum((high - low)[:, None], (high - low)[None])
    beyond = low[:, None] >= high[None] - touching  # (S, S, 4): the first lies on the far side of the second
    behind = ((away > ALONG) & beyond | (away < -ALONG) & beyond.swapaxes(0, 1)).any(-1)
    behind &= ~behind.T  # both: neither hides the other
    left, order = np.argsort(-(places[:, :3] @ view.axes[2]), kind="stable").tolist(), list[int]()
    while left:
        order.append(next((i for i in left if not behind[left, i].any()), left[0]))
        left.remove(order[-1])
    return order


def _patches(
    shape: Shape, pose: Float[np.ndarray, 7], view: View
) -> list[tuple[Float[np.ndarray, "K 2"], Colour, Colour | None]]:
    """Polygons in the picture's plane [m], back to front, each with its colour and that of its edge."""
    axes = view.axes
    if shape.kind != "mesh" or shape.faces is None:
        angles = 2 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
        around = np.cos(angles)[:, None] * axes[0] + np.sin(angles)[:, None] * axes[1]
        red, green, blue = (0.7 * part for part in shape.colour[:3])
        return [(support(shape, pose[None], around)[0] @ axes[:2].T, shape.colour, (red, green, blue, shape.colour[3]))]
    assert shape.vertices is not None
    corners = (shape.vertices.double().numpy() @ rotation(pose[3:]).T + pose[:3])[shape.faces.numpy()]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=-1)
    towards = normals @ axes[2] < 0
    light = 0.75 + 0.25 * np.clip(normals @ LIGHT / np.maximum(length, 1e-300), 0, 1)
    order = np.argsort(-(corners.mean(1) @ axes[2]), kind="stable")
    found: list[tuple[np.ndarray, Colour, Colour | None]] = []
    for k in order[towards[order]]:
        red, green, blue = (float(light[k] * part) for part in shape.colour[:3])
        found.append((corners[k] @ axes[:2].T, (red, green, blue, shape.colour[3]), None))
    return found


def _shade(colour: Colour, mix: float) -> tuple[int, int, int]:
    """A colour on its way to white, by transparency too."""
    share = colour[3] * (1 - mix)
    red, green, blue = (round(255 * (1 - share + share * part)) for part in colour[:3])
    return red, green, blue


def _polygon(
    draw: ImageDraw, pixels: Float[np.ndarray, "K 2"], fill: tuple[int, int, int], edge: tuple[int, int, int] | None
) -> None:
    corners = pixels.ravel().tolist()
    draw.polygon(corners, fill=fill, outline=fill)
    if edge:
        draw.line(corners + corners[:2], fill=edge, width=SMOOTH)
