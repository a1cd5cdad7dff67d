"""Checks that every physics engine must pass for policies to learn in it and parameters to be inferred.

| check     | what it asks                                                            |
|-----------|-------------------------------------------------------------------------|
| declared  | theta, nominal and state have the shapes, dtype and device it says      |
| repeats   | the same start and commands give the same path                          |
| batched   | four worlds at once move as each alone does                             |
| resets    | a reset under a mask touches its worlds only                            |
| rolls out | a rollout is its steps, and leaves the worlds where they are            |
| acts      | every parameter changes the path                                        |
"""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.simulators.base import Simulator

WORLDS, STEPS = 4, 8


def check_engine(simulator: Simulator, commands: int, *, scale: float = 1.0, atol: float = 1e-12) -> None:
    """Run every check.

    Args:
        simulator: any number of worlds; it is not touched.
        commands: number U of command columns.
        scale: standard deviation of the random commands [command units].
        atol: how far two paths may be apart that should be one [SI].

    Raises:
        AssertionError: of the first check that fails.
    """
    worlds, space = simulator.with_worlds(WORLDS), simulator.parameters
    generator = torch.Generator().manual_seed(0)
    unit = 0.2 + 0.6 * torch.rand(WORLDS, len(space), generator=generator, dtype=torch.float64)
    theta = space.from_unit(unit).to(worlds.device, worlds.dtype)
    command = scale * torch.randn(WORLDS, STEPS, commands, generator=generator, dtype=torch.float64)
    command = command.to(worlds.device, worlds.dtype)
    assert worlds.worlds == WORLDS, f"with_worlds({WORLDS}) gave {worlds.worlds}"
    assert worlds.nominal.shape == (len(space),), f"nominal has shape {tuple(worlds.nominal.shape)}"
    path = _path(worlds, theta, command)
    assert worlds.theta.shape == (WORLDS, len(space)), f"theta has shape {tuple(worlds.theta.shape)}"
    assert torch.equal(worlds.theta, theta), "theta is not what reset was given"
    assert worlds.state.batch_size == (WORLDS,), f"the state has batch size {tuple(worlds.state.batch_size)}"
    assert not worlds.failed.any(), "a world failed under mild commands"
    _same(_path(worlds, theta, command), path, 0.0, "the same start and commands twice")
    single = [_path(simulator.with_worlds(1), theta[i : i + 1], command[i : i + 1]) for i in range(WORLDS)]
    _same(torch.cat(single), path, atol, "a batch and single worlds")
    _check_reset(worlds, theta, command)
    _check_rollout(worlds, theta, command, path, atol)
    for i, name in enumerate(space.names):
        moved = theta.clone()
        moved[:, i] = space.from_unit(unit.clone().index_fill_(1, torch.tensor([i]), 0.95)).to(theta)[:, i]
        assert float((_flat(_path(worlds, moved, command)) - _flat(path)).abs().max()) > 0, f"{name} changes nothing"


def _path(worlds: Simulator, theta: Tensor, command: Tensor) -> TensorDict:
    """States (N, T) after each step from the default start."""
    worlds.reset(theta)
    steps = [TensorDict({"command": row}, batch_size=(len(theta),)) for row in command.unbind(1)]
    return torch.stack([worlds.step(inputs) for inputs in steps], dim=1)


def _check_reset(worlds: Simulator, theta: Tensor, command: Tensor) -> None:
    _path(worlds, theta, command)
    before = worlds.state
    mask = torch.tensor([True, False, True, False], device=worlds.device)
    worlds.reset(worlds.nominal.expand_as(theta), None, mask)
    after = worlds.state
    _same(after[~mask], before[~mask], 0.0, "worlds that do not reset")
    assert torch.equal(worlds.theta[~mask], theta[~mask]), "a reset under a mask changed another world's theta"
    assert float((_flat(after[mask]) - _flat(before[mask])).abs().max()) > 0, "worlds under the mask did not reset"


def _check_rollout(worlds: Simulator, theta: Tensor, command: Tensor, path: TensorDict, atol: float) -> None:
    worlds.reset(theta)
    start = worlds.state
    times = worlds.dt * torch.arange(1, STEPS + 1, dtype=torch.float64)
    rolled = worlds.rollout(theta, start, TensorDict({"command": command}, batch_size=command.shape[:2]), times)
    assert bool(rolled["valid"].all()), "a rollout under mild commands is not valid"
    _same(rolled.exclude("valid"), path, max(atol, 1e-9), "a rollout and its steps")
    _same(worlds.state, start, 0.0, "the worlds before and after a rollout")


def _same(first: TensorDict, second: TensorDict, atol: float, what: str) -> None:
    gap = float((_flat(first) - _flat(second)).abs().max())
    assert gap <= atol, f"{what} differ by {gap:.3g}"


def _flat(state: TensorDict) -> Tensor:
    return torch.cat([state[key].double().reshape(-1) for key in ("qpos", "qvel")])
