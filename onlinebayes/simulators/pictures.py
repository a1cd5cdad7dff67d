"""Pictures of worlds, for people and for policies that see.

A simulator that is :class:`Pictured` makes them itself (MuJoCo's renderer for an MJCF); any other is drawn by
:mod:`~onlinebayes.simulators.drawing` if it is :class:`~onlinebayes.simulators.Drawable`, always from the same place:
pictures of one world can be compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, UInt8
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.runs import BadInput
from onlinebayes.simulators.abilities import Extensible
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.drawing import Drawable, Shape, View, render_state, scene, view_of
from onlinebayes.simulators.task import Task

STARTS = 64  # states that decide what a picture shows


@runtime_checkable
class Pictured(Protocol):
    """A simulator that makes pictures of its worlds itself."""

    def picture(
        self,
        theta: Tensor,
        state: TensorDictBase,
        size: tuple[int, int],
        beside: tuple[Sequence[Shape], Tensor],
    ) -> np.ndarray:
        """One world (H, W, 3) uint8 with parameters theta (P,), in a state of no batch size.

        Args:
            theta: its parameters.
            state: its state.
            size: height and width [pixels].
            beside: shapes that the task adds, and their poses (S, 7).
        """
        ...


class Pictures:
    """Makes pictures of the worlds of an environment.

    Args:
        simulator, task: what is seen.
        size: height and width [pixels].

    Raises:
        BadInput: the simulator does not say what it looks like.
    """

    def __init__(self, simulator: Simulator, task: Task, size: tuple[int, int]) -> None:
        if not isinstance(simulator, Pictured | Drawable):
            raise BadInput(
                f"{type(simulator).__name__} does not say what it looks like",
                "give it shapes and poses, see onlinebayes.simulators.Drawable",
            )
        self.simulator, self.task, self.size = simulator, task, size
        self._view: View | None = None

    def one(self, theta: Float[Tensor, " P"], state: TensorDictBase) -> UInt8[np.ndarray, "H W 3"]:
        """A picture of one state, of no batch size."""
        theta, state = theta.cpu(), state.cpu()
        if isinstance(self.simulator, Pictured):
            shapes, poses = scene([self.task], theta, state.unsqueeze(0))
            return self.simulator.picture(theta, state, self.size, (shapes, poses[0]))
        if self._view is None:
            self._view = _wide_view(self.simulator, self.task)
        return render_state([self.simulator, self.task], theta, state, size=self.size, view=self._view)

    def all(self, theta: Float[Tensor, "N P"], state: TensorDictBase) -> UInt8[Tensor, "N H W 3"]:
        """Pictures of all worlds."""
        seen = [self.one(row, one) for row, one in zip(theta, state.unbind(0), strict=True)]
        return torch.from_numpy(np.stack(seen)).to(theta.device)


def _wide_view(simulator: Simulator, task: Task) -> View:
    """Return a view that holds the worlds at many starts, every hinge at any angle, for small and large parameters.

    Parameters up to twice the nominal ones: bounds may be so wide that nothing else could be seen.
    """
    generator = torch.Generator(simulator.device).manual_seed(0)
    views = []
    for share in (0.0, 0.5, 1.0):
        unit = torch.full((STARTS, len(simulator.parameters)), share, dtype=torch.float64)
        theta = simulator.parameters.from_unit(unit).to(simulator.nominal)
        theta = torch.where(simulator.nominal > 0, theta.minimum(2 * simulator.nominal), theta)
        start = task.start(theta, generator).to("cpu")
        states = torch.cat([start, *_swept(simulator, start)])
        shapes, poses = scene([simulator, task], theta[0].cpu(), states)
        views.append(view_of(shapes, poses))
    turn = max((view.turn for view in views), key=lambda turn: math.hypot(*turn))
    low = np.min([view.low for view in views], axis=0).tolist()
    high = np.max([view.high for view in views], axis=0).tolist()
    return View((low[0], low[1]), (high[0], high[1]), turn)


def _swept(simulator: Simulator, start: TensorDict) -> list[TensorDict]:
    """The starts with one hinge after another turned all the way round."""
    if not isinstance(simulator, Extensible) or start["qpos"].shape[1] != len(simulator.joint_kinds):
        return []
    around = torch.linspace(-math.pi, math.pi, len(start), dtype=start["qpos"].dtype)
    hinges = [column for column, kind in enumerate(simulator.joint_kinds.values()) if kind == "hinge"]
    turned = [start.clone() for _ in hinges]
    for column, state in zip(hinges, turned, strict=True):
        state["qpos"][:, column] = around
    return turned
