"""Checks that every simulator through which logs are replayed must pass; :mod:`.engine` asks less."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.sensing import sense
from onlinebayes.simulators.testing.trials import Trial, require, require_same, step_inputs, walk

_PATIENCE = 8  # times the trial's steps within which a NaN in a command must have made its world fail


def check_simulator(
    simulator: Identifiable,
    *,
    steps: int = 8,
    scale: float = 1.0,
    atol: float = 0.0,
    inert: Sequence[str] = (),
    seed: int = 0,
) -> None:
    """Raise AssertionError unless the simulator keeps the contract of :class:`~onlinebayes.simulators.Identifiable`.

    Checked: shapes, dtype and device; the same inputs give the same bits; a batch equals single worlds; a partial reset
    touches only its worlds; a rollout equals its steps, at coarser times too; a saved state restores the future; an
    ``enable`` of ones is nothing; a world that diverges is flagged, held, and harms no other; every parameter acts;
    ``with_worlds``, and ``with_timestep`` and ``with_runge_kutta`` where there are such.

    Args:
        simulator: any number of worlds; it is not touched.
        steps: length of the trajectories.
        scale: standard deviation of the random commands [command units].
        atol: how far a batch may be from single worlds [SI]; 0 asks for the same bits. Vectorised mathematical
            functions may round differently with the batch size: 1e-12 suits them.
        inert: parameters that need not change the trajectories tried.
        seed: of parameters and commands.
    """
    worlds = simulator.with_worlds(4)
    _check_declared(worlds)
    trial = Trial.draw(worlds, steps, scale, seed)
    path = _restart(worlds, trial)
    _check_tensors(worlds, path)
    require_same(path, _restart(worlds, trial), 0.0, "the same inputs twice")
    _check_rollout(worlds, trial, path)
    _check_completeness(worlds, trial, path)
    _check_single(worlds, trial, path, atol)
    _check_partial_reset(worlds, trial)
    _check_enable(worlds, trial, path)
    _check_failure(worlds, trial)
    _check_parameters(worlds, trial, path, inert)
    _check_integration(worlds)


def _restart(worlds: Identifiable, trial: Trial) -> TensorDict:
    worlds.reset(trial.theta, trial.start)
    return walk(worlds, trial.command)


def _check_declared(worlds: Identifiable) -> None:
    require(worlds.worlds == 4, f"with_worlds(4) has {worlds.worlds} worlds")
    count = worlds.dt / worlds.timestep
    require(abs(count - round(count)) < 1e-6 and count > 0.5, "dt is no whole number of timesteps")
    require(worlds.nominal.shape == (len(worlds.parameters),), f"nominal has shape {tuple(worlds.nominal.shape)}")
    require(worlds.theta.shape == (4, len(worlds.parameters)), f"theta has shape {tuple(worlds.theta.shape)}")
    for kind, names in (("command", worlds.commands), ("signal", worlds.signals)):
        require(len(set(names)) == len(names), f"a {kind} name stands twice: {names}")


def _check_tensors(worlds: Identifiable, path: TensorDict) -> None:
    require(not bool(worlds.failed.any()), "a world failed under the random commands: lower scale or steps")
    state = worlds.state
    require(state.batch_size == (4,), f"a state has batch size {tuple(state.batch_size)}, not (4,)")
    for key in ("qpos", "qvel"):
        require(state.get(key, None) is not None, f"a state lacks '{key}'")
        part = state[key]
        require(part.dtype == worlds.dtype and part.device == worlds.device, f"{key} is {part.dtype} on {part.device}")
    signals = worlds.read(path)
    require(signals.shape == (*path.batch_size, len(worlds.signals)), f"read() gives shape {tuple(signals.shape)}")
    state["qpos"].add_(1.0)
    require(not torch.equal(state["qpos"], worlds.state["qpos"]), "state is a view of the simulator's memory, no copy")


def _check_rollout(worlds: Identifiable, trial: Trial, path: TensorDict) -> None:
    before = worlds.state
    rolled = worlds.rollout(trial.theta, trial.start, trial.inputs, trial.times)
    require_same(rolled, path, 0.0, "a rollout against its steps")
    require(bool(rolled["valid"].all()), "a rollout is invalid where its steps did not fail")
    require_same(worlds.state, before, 0.0, "the worlds of step() after a rollout")
    half = trial.inputs[:, ::2].clone()
    held = half["command"].repeat_interleave(2, dim=1)[:, : len(trial.times)]
    fine = TensorDict({"command": held}, batch_size=held.shape[:2])
    whole = worlds.rollout(trial.theta, trial.start, fine, trial.times)
    every = len(trial.times) // 2
    coarse = worlds.rollout(trial.theta, trial.start, half[:, :every], trial.times[1::2][:every])
    require_same(coarse, whole[:, 1::2][:, :every], 0.0, "a rollout at every other instant")
    fewer = worlds.rollout(trial.theta[:3], trial.start[:3], trial.inputs[:3], trial.times)
    require(fewer.batch_size == (3, len(trial.times)), "a rollout of 3 rows does not give 3 rows")


def _check_completeness(worlds: Identifiable, trial: Trial, path: TensorDict) -> None:
    middle = len(trial.times) // 2
    worlds.reset(trial.theta, path[:, middle - 1].clone())
    require_same(
        walk(worlds, trial.command[:, middle:]), path[:, middle:], 0.0, "the future of a saved and restored state"
    )
    rest = trial.inputs[:, middle:]
    rolled = worlds.rollout(trial.theta, path[:, middle - 1].clone(), rest, trial.times[: len(trial.times) - middle])
    require_same(rolled, path[:, middle:], 0.0, "a rollout split in two")


def _check_single(worlds: Identifiable, trial: Trial, path: TensorDict, atol: float) -> None:
    single = worlds.with_worlds(1)
    for i in range(worlds.worlds):
        one = Trial(trial.theta[i : i + 1], trial.start[i : i + 1], trial.command[i : i + 1], trial.times)
        require_same(_restart(single, one), path[i : i + 1], atol, f"world {i} alone against world {i} of 4")


def _check_partial_reset(worlds: Identifiable, trial: Trial) -> None:
    _restart(worlds, trial)
    before = worlds.state
    mask = torch.tensor([True, False, True, False], device=worlds.device)
    other = trial.theta.flip(0)
    worlds.reset(other, trial.start, mask)
    after, theta = worlds.state, worlds.theta
    require_same(after[~mask], before[~mask], 0.0, "worlds outside the mask of a reset")
    # What sensors read belongs to a state and a theta together, and theta is another one now.
    reset, wanted = after[mask].exclude("sensor"), trial.start[mask].exclude("sensor")
    require_same(reset, wanted, 0.0, "worlds under the mask of a reset")
    mixed = torch.where(mask[:, None], other, trial.theta)
    require(torch.equal(theta, mixed), "a partial reset did not give exactly its worlds the new theta")
    worlds.reset(other, trial.start, torch.zeros_like(mask))
    require_same(worlds.state, after, 0.0, "a reset of no world at all")
    path = walk(worlds, trial.command)
    worlds.reset(mixed, after)
    require_same(path, walk(worlds, trial.command), 0.0, "worlds after a partial reset against a whole one")


def _check_enable(worlds: Identifiable, trial: Trial, path: TensorDict) -> None:
    inputs = trial.inputs.set("enable", torch.ones_like(trial.command))
    rolled = worlds.rollout(trial.theta, trial.start, inputs, trial.times)
    require_same(rolled, path, 0.0, "a rollout whose enable is 1 throughout")


def _check_failure(worlds: Identifiable, trial: Trial) -> None:
    """A command that is NaN from the second step on, long enough to arrive through a delay."""
    if not worlds.commands:
        return
    command = trial.command.repeat(1, _PATIENCE, 1)
    times = worlds.dt * torch.arange(1, command.shape[1] + 1, dtype=torch.float64, device=worlds.device)
    path = worlds.rollout(trial.theta, trial.start, _rows(command), times)
    command[1, 1:] = torch.nan
    worlds.reset(trial.theta, trial.start)
    walked = walk(worlds, command)
    others = torch.tensor([0, 2, 3], device=worlds.device)
    require(worlds.failed.tolist() == [False, True, False, False], f"failed is {worlds.failed.tolist()} after a NaN")
    require_same(walked[others], path[others], 0.0, "the worlds beside one that diverged")
    require(bool(walked["qpos"].isfinite().all()), "a world that diverged does not keep its last finite state")
    rolled = worlds.rollout(trial.theta, trial.start, _rows(command), times)
    require_same(rolled[others], path[others], 0.0, "the rows beside one that diverged")
    require(bool(rolled["valid"][others].all()), "a row beside one that diverged is invalid")
    require(bool(rolled["valid"][1, 0]) and not bool(rolled["valid"][1, -1]), "valid does not fall with the divergence")
    require(bool(rolled["qpos"].isfinite().all()), "a row that diverged is not held at its last finite state")
    worlds.reset(trial.theta, trial.start, torch.tensor([False, True, False, False], device=worlds.device))
    require(not bool(worlds.failed.any()), "a world that was reset still counts as failed")
    worlds.step(step_inputs(trial.command[:, 0]))
    require_same(worlds.state[1:2], path[1:2, 0], 0.0, "a world that was reset after it diverged")


def _rows(command: Float[Tensor, "N T U"]) -> TensorDict:
    return TensorDict({"command": command}, batch_size=command.shape[:2])


def _check_parameters(worlds: Identifiable, trial: Trial, path: TensorDict, inert: Sequence[str]) -> None:
    for i, name in enumerate(worlds.parameters):
        if name in inert:
            continue
        theta = trial.theta.clone()
        middle = (worlds.parameters.low[i] + worlds.parameters.high[i]) / 2
        theta[:, i] = torch.where(theta[:, i] < middle, worlds.parameters.high[i], worlds.parameters.low[i])
        moved = worlds.rollout(theta, trial.start, trial.inputs, trial.times)
        shown, base = (sense(worlds, t, trial.start, p, trial.times) for t, p in ((theta, moved), (trial.theta, path)))
        require(not torch.equal(shown, base), f"parameter {name} changes nothing")


def _check_integration(worlds: Identifiable) -> None:
    if type(worlds).with_timestep is not Identifiable.with_timestep:
        finer = worlds.with_timestep(worlds.timestep / 2)
        require(finer.timestep == worlds.timestep / 2 == finer.dt, "with_timestep does not set timestep and dt")
        same = finer.parameters == worlds.parameters and finer.effects == worlds.effects
        require(same, "with_timestep drops parameters")
    if type(worlds).with_runge_kutta is not Identifiable.with_runge_kutta:
        smooth = worlds.with_runge_kutta()
        require(smooth.timestep == worlds.timestep and smooth.dt == worlds.dt, "with_runge_kutta changes steps")
        same = smooth.parameters == worlds.parameters and smooth.effects == worlds.effects
        require(same, "with_runge_kutta drops parameters")
        require(smooth.with_runge_kutta() is smooth, "with_runge_kutta twice is not once")
    quick = worlds.with_first_order()
    same = quick.parameters == worlds.parameters and quick.effects == worlds.effects
    require(same and quick.timestep == worlds.timestep, "with_first_order drops parameters or changes steps")
    require(quick.with_first_order() is quick, "with_first_order twice is not once")
    denser = worlds.with_scaled_moments()
    require(denser.parameters == worlds.parameters, "with_scaled_moments drops parameters")
    require(denser.with_scaled_moments() is denser, "with_scaled_moments twice is not once")
    soft = worlds.with_soft_friction()
    same = soft.parameters == worlds.parameters and soft.effects == worlds.effects
    require(same and soft.timestep == worlds.timestep, "with_soft_friction drops parameters or changes steps")
    require(soft.with_soft_friction() is soft, "with_soft_friction twice is not once")
