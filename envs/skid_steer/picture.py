"""Drawing of the robot and its circle: a body, four wheels of their true radius, a ball at the centre of rotation."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.simulators.drawing import BLUE, DARK, RED, Shape

GREEN = (0.25, 0.65, 0.35, 1.0)
LENGTH, WIDTH = 0.4, 0.02  # of the body, of the ring's band [m]
SEGMENTS = 96  # of the ring


def shapes(radius: float, axial: float) -> tuple[Shape, ...]:
    """Body, wheels, and the ball."""
    sizes = (LENGTH / 2, 0.35 * axial, max(0.5 * radius, 0.02))
    wheels = (f"{end} {side} wheel" for end in ("front", "rear") for side in ("left", "right"))
    return (
        Shape("body", "box", sizes, BLUE),
        *(Shape(name, "cylinder", (radius, 0.1 * axial), DARK) for name in wheels),
        Shape("centre of rotation", "sphere", (0.03,), RED),
    )


def poses(radius: float, axial: float, x_icr: float, pose: Float[Tensor, "T 3"]) -> Float[Tensor, "T 6 7"]:
    """Poses of :func:`shapes` at x, y, yaw."""
    pose = pose.double()
    half, aside = 0.4 * LENGTH, 0.5 * axial
    wheels = [(x, y, radius) for x in (half, -half) for y in (aside, -aside)]
    places = pose.new_tensor([(0.0, 0.0, 1.5 * radius), *wheels, (x_icr, 0.0, 3 * radius)])
    x, y, yaw = (column[:, None] for column in pose.unbind(-1))
    cos, sin = yaw.cos(), yaw.sin()
    at = torch.stack(
        (
            x + places[:, 0] * cos - places[:, 1] * sin,
            y + places[:, 0] * sin + places[:, 1] * cos,
            places[:, 2].expand(len(pose), -1),
        ),
        dim=-1,
    )
    turned = torch.cat((torch.cos(yaw / 2), torch.zeros_like(yaw), torch.zeros_like(yaw), torch.sin(yaw / 2)), dim=-1)
    # A wheel's axle, its own z, lies along the robot's y: a quarter turn about x before the yaw.
    c, s = math.sqrt(0.5) * turned[:, 0], math.sqrt(0.5) * turned[:, 3]
    rolled = torch.stack((c, c, s, s), dim=-1)
    turns = torch.stack((turned, *[rolled] * 4, turned), dim=1)
    return torch.cat((at, turns), dim=-1)


def ring(radius: float) -> Shape:
    """A flat band around the origin, seen from above."""
    angle = 2 * math.pi * torch.arange(SEGMENTS, dtype=torch.float64) / SEGMENTS
    around = torch.stack((angle.cos(), angle.sin(), torch.zeros_like(angle)), dim=-1)
    inner, outer = torch.arange(SEGMENTS), SEGMENTS + torch.arange(SEGMENTS)
    after = (inner + 1) % SEGMENTS
    faces = torch.cat((torch.stack((inner, outer, outer[after]), -1), torch.stack((inner, outer[after], after), -1)))
    vertices = torch.cat(((radius - WIDTH / 2) * around, (radius + WIDTH / 2) * around))
    return Shape("circle", "mesh", (), GREEN, moving=False, vertices=vertices, faces=faces)


def at_origin(pose: Float[Tensor, "T 3"]) -> Float[Tensor, "T 1 7"]:
    """The pose of what stands at the origin."""
    return pose.new_tensor((0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)).double().expand(len(pose), 1, -1)
