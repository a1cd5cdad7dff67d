"""Checks that every effect must pass, on each simulator that carries it."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

import torch
from tensordict import TensorDict

from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect, Scales, Seen, Servo
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.sensing import sense, unsense
from onlinebayes.simulators.standalone import StandaloneModel
from onlinebayes.simulators.testing.simulator import check_simulator
from onlinebayes.simulators.testing.trials import Trial, require, require_same


def check_effect(
    simulator: Identifiable, effect: Effect, *, steps: int = 8, scale: float = 1.0, atol: float = 0.0, seed: int = 0
) -> None:
    """Raise AssertionError unless the effect keeps the contract of :class:`Effect` on this simulator.

    Checked: its parameters join the space under its key; at its neutral value it changes not a bit; elsewhere it acts;
    with it the simulator passes :func:`check_simulator`, hidden states included; its hidden states along many rows at
    once are those of one row after the other; a law in plain Python replays alike beside MJCF; starting values and the
    bounds for screening are admissible; numbers that are the same law are numbers of what it acts on; an unknown target
    and a second copy are refused.

    Args:
        simulator: without the effect; it is not touched.
        effect: any of a target that the simulator has.
        steps: length of the trajectories.
        scale: standard deviation of the random commands [command units].
        atol: as for :func:`check_simulator`.
        seed: of parameters and commands.
    """
    _check_declared(effect)
    _check_along(effect, seed)
    grown = simulator.with_effect(effect)
    names = tuple(f"{effect.key}.{name}" for name in effect.parameters)
    require(grown.parameters.names == (*simulator.parameters.names, *names), f"the space is {grown.parameters.names}")
    require(grown.effects == (*simulator.effects, effect), "effects does not end with the new one")
    require(grown.commands == simulator.commands, f"the effect changed the commands to {grown.commands}")
    require(grown.signals == simulator.signals, f"the effect changed the signals to {grown.signals}")
    neutral = torch.tensor([effect.neutral[n] for n in effect.parameters], dtype=grown.dtype, device=grown.device)
    require(torch.equal(grown.nominal[len(simulator.parameters) :], neutral), "nominal is not neutral")
    _check_neutral(simulator, grown, steps, scale, seed)
    check_simulator(grown, steps=steps, scale=scale, atol=atol, seed=seed)
    _check_standalone(grown, steps, scale, seed)
    _check_refusals(grown, simulator, effect)


def _check_declared(effect: Effect) -> None:
    space, numbers = effect.parameters, effect.same_law_as
    for number in numbers:
        form = f"{effect.target_kind}.*."
        require(number.startswith(form) and number.count("*") == 1, f"same_law_as names {number}, not {form}field")
    require(len(numbers) in (0, len(effect.axes) or 1), f"same_law_as names {numbers}, the axes are {effect.axes}")
    require(set(effect.neutral) == set(space), f"neutral names {set(effect.neutral)}, parameters are {set(space)}")
    scaled = type(effect).scaled(effect.target, Scales(force=3.0, speed=2.0, travel=1.5, time=0.05, centre=4.0))
    require(scaled.target == effect.target and scaled.key == effect.key, "scaled() changes the target")
    require(tuple(scaled.parameters) == tuple(space), "scaled() has other parameters")
    for each in (effect, scaled):
        require(
            bool(each.parameters.contains(each.parameters.vector(each.neutral))), f"neutral is out of bounds: {each}"
        )
        hidden = each.rest(1, 1e-3, torch.zeros(()))
        require((hidden is not None) == (each.memory > 0), f"memory is {each.memory:g} s, the hidden state {hidden}")
        for start in each.starts:
            require(bool(each.parameters.contains(each.parameters.vector(start))), f"start {start} is out of bounds")
            require(start != dict(each.neutral), "a start is the neutral value")


def _check_along(effect: Effect, seed: int, worlds: int = 3, rows: int = 9, timestep: float = 0.01) -> None:
    """A force stage's hidden states along given rows are those of walking through them."""
    generator = torch.Generator().manual_seed(seed)
    rest = effect.rest(worlds, timestep, torch.zeros((), dtype=torch.float64))
    if rest is None or not effect.has_force:
        return
    unit = torch.rand(worlds, len(effect.parameters), generator=generator, dtype=torch.float64)
    own = effect.parameters.view(effect.parameters.from_unit(unit))
    q, v, drive, command = torch.randn(4, worlds, rows, generator=generator, dtype=torch.float64)
    servo = None
    if effect.needs_servo:
        force, stiffness, damping, limit = torch.rand(4, worlds, rows, generator=generator, dtype=torch.float64)
        servo = Servo(force, stiffness, damping, -limit, limit)
    seen = Seen(q, v, drive, command, rest, timestep, servo)
    together, walked = effect.along(own, seen), Effect.along(effect, own, seen)
    if together is None or walked is None:
        raise AssertionError(f"{effect.key} has a hidden state, and none along a motion")
    require_same(together, walked, 1e-12, "the hidden state along rows at once against row by row")


def _check_neutral(simulator: Identifiable, grown: Identifiable, steps: int, scale: float, seed: int) -> None:
    base = simulator.with_worlds(3)
    trial = Trial.draw(base, steps, scale, seed)
    theta = torch.cat([trial.theta, grown.nominal[len(base.parameters) :].expand(3, -1)], dim=1)
    plain = base.rollout(trial.theta, trial.start, trial.inputs, trial.times)
    with_effect = grown.rollout(theta, trial.start, trial.inputs, trial.times)
    hidden = set(plain.keys(True, True)) ^ set(with_effect.keys(True, True))
    require_same(with_effect.exclude(*hidden), plain, 0.0, "the effect at its neutral value against none")
    shown = sense(grown, theta, trial.start, with_effect, trial.times)
    bare = sense(base, trial.theta, trial.start, plain, trial.times)
    require(torch.equal(shown, bare), "the effect at its neutral value changes what sensors show")
    behind, bare_behind = unsense(grown, theta, trial.start), unsense(base, trial.theta, trial.start)
    require_same(behind, bare_behind, 0.0, "the effect at its neutral value changes the state behind a reading")


def _check_standalone(grown: Identifiable, steps: int, scale: float, seed: int) -> None:
    """On MuJoCo the law beside a file without the effect replays as the simulator does."""
    if not isinstance(grown, MujocoSimulator):
        return
    one = grown.with_worlds(1)
    trial = Trial.draw(one, steps, scale, seed)
    held = one.in_file(trial.theta[0])
    assert isinstance(held.simulator, MujocoSimulator)
    setup, without = one.beside_file(trial.theta[0], held.simulator.export(held.theta), held.without)
    if not held.without or without:
        return
    start = one.reset(trial.theta)  # at rest, as the law is
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        path.write_text(held.simulator.export_xml(held.theta))
        model = StandaloneModel(path, setup)
    model.reset(start["qpos"][0].numpy(), start["qvel"][0].numpy())
    command = trial.command.repeat_interleave(round(one.dt / one.timestep), 1)  # a late sensor reads each timestep
    times = one.timestep * torch.arange(1, command.shape[1] + 1, dtype=torch.float64)
    shown = torch.tensor([list(model.step(u).values()) for u in command[0].numpy()])
    inputs = TensorDict({"command": command}, batch_size=command.shape[:2])
    wanted = sense(one, trial.theta, start, one.rollout(trial.theta, start, inputs, times), times)[0]
    off, size = float((shown - wanted).abs().max()), float(wanted.abs().max())
    require(off <= 1e-6 * size, f"the law in plain Python is off by {off:g} of {size:g}")


def _check_refusals(grown: Identifiable, simulator: Identifiable, effect: Effect) -> None:
    def strange() -> Identifiable:
        return simulator.with_effect(dataclasses.replace(effect, target="no such target"))  # type: ignore[type-var]

    for what, act in (
        ("a second copy", lambda: grown.with_effect(effect)),
        ("an unknown target", strange),
    ):
        try:
            act()
        except BadInput:
            continue
        raise AssertionError(f"{what} of {effect.key} was not refused with BadInput")
