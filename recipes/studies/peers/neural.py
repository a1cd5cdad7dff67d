"""Peer (c): a small network on top of the engineer's model, trained on the force that the model does not account for.

    F(q, v, u, u') = MLP(standardised inputs),    loss  mean |F - F_measured|^2,    early stopping on held-back windows

u' is the command of some milliseconds ago, so that lateness can be learnt. Width of the smoothing and whether there is
to be a network at all are those with the smallest open-loop error on the windows held back. It names nothing.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor, nn

from onlinebayes.identification import Windows, joint_names
from onlinebayes.runs import generator
from onlinebayes.simulators.mujoco import MujocoSimulator
from recipes.studies.peers.motion import Motion, folds, forces, motion
from recipes.studies.peers.task import Claim, Fitted, Task, open_loop_error
from recipes.studies.peers.worlds import Course, course, simulate

SMOOTHING = (0.04, 0.08, 0.12, 0.2)
WIDTH, EPOCHS, PATIENCE, BATCH, RATE, DECAY = 32, 300, 30, 256, 3e-3, 1e-4
ROWS = 6000
DEAD_TIME = 10e-3


@final
@dataclass(frozen=True)
class Net:
    """F with its scales.

    Args:
        layers: the network.
        middle, size: of its inputs.
        force: of its outputs [N, N m].
        largest: beyond how many times ``force`` its outputs are cut off: it knows nothing out there.
    """

    layers: nn.Module
    middle: Float[Tensor, " I"]
    size: Float[Tensor, " I"]
    force: Float[Tensor, " J"]
    largest: float = 10.0

    def __call__(self, q: ndarray, v: ndarray, now: Course) -> Float[ndarray, "N J"]:
        """Forces at N states."""
        with torch.no_grad():
            scaled = self.layers((inputs(q, v, now) - self.middle) / self.size)
        return (scaled.clamp(-self.largest, self.largest) * self.force).numpy()


@final
@dataclass(frozen=True)
class Hybrid(Fitted):
    """The base model with a network on top; without one where none helped.

    Args:
        simulator, theta: the base model, fitted.
        net: F, or None.
        claims: none, always.
    """

    simulator: MujocoSimulator
    theta: Float[Tensor, " P"]
    net: Net | None
    claims: tuple[Claim, ...] = ()

    def predict(self, windows: Windows) -> Float[Tensor, "W K S"]:
        """See :class:`Fitted`."""
        theta = np.tile(self.theta.numpy(), (windows.count, 1))
        return simulate(self.simulator, theta, windows, self.net or _nothing, driven(windows))


def fit(task: Task) -> Hybrid:
    """Train one network for each width of the smoothing, and keep what predicts the held-back windows best."""
    windows = task.fit_windows
    back = folds(windows) == 0
    held = windows.select(torch.from_numpy(np.flatnonzero(back)))
    best = Hybrid(task.simulator, task.base_theta, None)
    least = _error(task, held, best)
    for seconds in SMOOTHING:
        trained = Hybrid(task.simulator, task.base_theta, _trained(task, motion(task, seconds, ROWS), back))
        if (error := _error(task, held, trained)) < least:
            best, least = trained, error
    return best


def driven(windows: Windows) -> Course:
    """The commands, and what they were a dead time ago."""
    each = np.ones(windows.command.shape[2])
    return course(windows, DEAD_TIME * each, 0 * each, each, each)


def inputs(q: ndarray, v: ndarray, now: Course) -> Float[Tensor, "N I"]:
    """What the network sees."""
    return torch.from_numpy(np.concatenate([q, v, now.command, now.late], 1))


def _trained(task: Task, moved: Motion, back: ndarray) -> Net:
    """Adam on minibatches until the held-back rows have not improved for some epochs; the best epoch is kept."""
    now = driven(task.fit_windows).centred()
    simulator, theta = task.simulator, task.base_theta.numpy()
    y = torch.from_numpy(forces(simulator, theta, moved, now.command).residual)
    x = inputs(moved.at(moved.q), moved.at(moved.v), now.flat().picked(moved.kept))
    force = y.square().mean(0).sqrt().clamp_min(1e-12)
    middle, size, y = x.mean(0), x.std(0).clamp_min(1e-9), y / force
    x, held = (x - middle) / size, torch.from_numpy(back[moved.window])
    draw = generator(0, "neural residual")
    layers = _layers(x.shape[1], len(joint_names(simulator)), draw)
    optimizer = torch.optim.Adam(layers.parameters(), RATE, weight_decay=DECAY)
    kept, least, since = copy.deepcopy(layers), float("inf"), 0
    fitted = torch.nonzero(~held)[:, 0]
    for _ in range(EPOCHS):
        for part in fitted[torch.randperm(len(fitted), generator=draw)].split(BATCH):
            optimizer.zero_grad()
            (layers(x[part]) - y[part]).square().mean().backward()
            optimizer.step()
        with torch.no_grad():
            loss = float((layers(x[held]) - y[held]).square().mean())
        since += 1
        if loss < least:
            kept, least, since = copy.deepcopy(layers), loss, 0
        elif since > PATIENCE:
            break
    return Net(kept, middle, size, force)


def _layers(inward: int, outward: int, draw: torch.Generator) -> nn.Sequential:
    """Two hidden layers; it begins as nothing at all."""
    last = nn.Linear(WIDTH, outward)
    layers = nn.Sequential(nn.Linear(inward, WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh(), last).double()
    with torch.no_grad():
        for layer in layers:
            if isinstance(layer, nn.Linear):
                layer.weight.copy_(torch.randn(layer.weight.shape, generator=draw) / layer.in_features**0.5)
                layer.bias.zero_()
        last.weight.zero_()
    return layers


def _error(task: Task, windows: Windows, fitted: Hybrid) -> float:
    """Open-loop error in floors; inf where it diverged."""
    squares = open_loop_error(windows, fitted.predict(windows)).sum(0) / windows.measured.sum((0, 1)).clamp_min(1)
    return float((squares / task.noise.square()).mean().sqrt())


def _nothing(q: ndarray, v: ndarray, now: Course) -> ndarray:
    del v, now
    return np.zeros_like(q)
