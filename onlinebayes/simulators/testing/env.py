"""Checks that every environment of a simulator and a task must pass.

| check      | what it asks                                                                                    |
|------------|-------------------------------------------------------------------------------------------------|
| specs      | TorchRL's own ``check_env_specs``                                                               |
| episodes   | finite data; done is terminated or truncated; a world that goes on is left alone by resets      |
| repeats    | one seed, one path                                                                              |
| theta      | read where worlds reset, carried, kept without one; refused outside its bounds                  |
| goes on    | from its ``state_dict`` to the last bit, in an environment built anew                           |
| copies     | ``copy.deepcopy`` and ``pickle`` stand where the original does and leave it alone               |
| set state  | ``reset(set_state=True)`` puts worlds back, all of them or some                                 |
| wild       | actions that are no numbers give finite data                                                    |
"""

from __future__ import annotations

import copy
import io
import pickle
from collections.abc import Callable

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import check_env_specs

from onlinebayes.runs import BadInput
from onlinebayes.simulators.env import SimulatorEnv
from onlinebayes.simulators.testing.trials import require, require_same


def check_env(make_env: Callable[[], SimulatorEnv], *, steps: int = 12, atol: float = 0.0, seed: int = 0) -> None:
    """Run every check.

    Args:
        make_env: a new environment with at least two worlds; two of them with one seed behave alike.
        steps: of the paths; more than an episode has, so that worlds reset on the way.
        atol: how far a world that was put back may be from the first time; everything else is compared to the bit.
        seed: of environments, parameters and actions.

    Raises:
        AssertionError: of the first check that fails.
        ValueError: the environment has one world.
    """
    env = make_env()
    if env.batch_size.numel() < 2:
        raise ValueError("check_env needs at least two worlds: some reset while others go on")
    check_env_specs(env, seed=seed)
    trial = _Trial(steps, seed)
    _check_episodes(env, trial)
    _check_repeats(make_env, trial)
    _check_theta(env, trial)
    _check_goes_on(make_env, trial)
    _check_copies(env, trial)
    _check_set_state(env, trial, atol)
    _check_wild(env, trial)


class _Trial:
    """Parameters, actions and paths of the checks."""

    def __init__(self, steps: int, seed: int) -> None:
        self.steps, self.seed = steps, seed
        self._generator = torch.Generator().manual_seed(seed)

    def theta(self, env: SimulatorEnv) -> Tensor:
        space = env.simulator.parameters
        unit = 0.1 + 0.8 * torch.rand(env.simulator.worlds, len(space), generator=self._generator, dtype=torch.float64)
        return space.from_unit(unit).to(env.device, env.simulator.dtype)

    def reset(self, env: SimulatorEnv, theta: Tensor | None = None, mask: Tensor | None = None) -> TensorDictBase:
        given = TensorDict(batch_size=env.batch_size, device=env.device)
        if theta is not None:
            given.set(env.theta_key, theta)
        if mask is not None:
            given.set("_reset", mask)
        return env.reset(given)

    def path(self, env: SimulatorEnv, start: TensorDictBase, steps: int | None = None) -> TensorDictBase:
        """The same random actions from where the worlds stand; those that end reset."""
        with torch.random.fork_rng():
            torch.manual_seed(self.seed)
            return env.rollout(
                steps or self.steps, auto_reset=False, tensordict=start.clone(), break_when_any_done=False
            )


def _check_episodes(env: SimulatorEnv, trial: _Trial) -> None:
    data = trial.path(env, trial.reset(env, trial.theta(env)))
    after = data["next"]
    for key, value in after.items(True, True):
        require(bool(value.isfinite().all()), f"{key!r} is not finite under random actions")
    require(torch.equal(after["done"], after["terminated"] | after["truncated"]), "done is not terminated or truncated")
    going = ~after["done"][:, :-1, 0]
    for key in env.observation_spec.keys(True, True):
        same = torch.equal(data[key][:, 1:][going], after[key][:, :-1][going])
        require(same, f"{key!r} of a world that goes on is changed where others reset")


def _check_repeats(make_env: Callable[[], SimulatorEnv], trial: _Trial) -> None:
    paths = []
    for _ in range(2):
        env = make_env()
        env.set_seed(trial.seed + 1)
        paths.append(trial.path(env, env.reset()))
    require_same(paths[1], paths[0], 0.0, "one seed in two environments")


def _check_theta(env: SimulatorEnv, trial: _Trial) -> None:
    old, new = trial.theta(env), trial.theta(env)
    mask = torch.zeros(*env.batch_size, 1, dtype=torch.bool, device=env.device)
    mask[::2] = True
    wanted = torch.where(mask, new, old)
    # TorchRL leaves what it is given in the rows of worlds that do not reset.
    found = [trial.reset(env, old), trial.reset(env, wanted, mask), trial.reset(env)]
    found.append(env.rand_step(found[-1].clone())["next"])
    words = ("a reset", "a reset of some worlds", "a reset that was given none", "a step")
    for data, theta, where in zip(found, (old, wanted, wanted, wanted), words, strict=True):
        require(torch.equal(data[env.theta_key], theta), f"theta after {where} is not what it should be")
    require(torch.equal(env.simulator.theta, wanted), "the simulator runs on other parameters than are shown")
    low, high = env.simulator.parameters.low[0], env.simulator.parameters.high[0]
    for value in (float("nan"), float(high + (high - low))):
        wrong = old.clone()
        wrong[0, 0] = value
        try:
            trial.reset(env, wrong)
        except BadInput:
            require(torch.equal(trial.reset(env)[env.theta_key], wanted), "a theta that was refused left its trace")
            trial.reset(env, wrong, ~mask)  # not of a world that resets
            continue
        raise AssertionError(f"{env.simulator.parameters.names[0]} = {value} was not refused with BadInput")


def _check_goes_on(make_env: Callable[[], SimulatorEnv], trial: _Trial) -> None:
    env, other = make_env(), make_env()
    start = _ahead(trial.path(env, trial.reset(env, trial.theta(env)), 3))
    file = io.BytesIO()
    torch.save(env.state_dict(), file)
    file.seek(0)
    first = trial.path(env, start)
    trial.path(other, trial.reset(other, trial.theta(other)), 2)
    other.load_state_dict(torch.load(file, weights_only=True))
    require_same(trial.path(other, start), first, 0.0, "an environment from its state_dict")


def _check_copies(env: SimulatorEnv, trial: _Trial) -> None:
    start = _ahead(trial.path(env, trial.reset(env, trial.theta(env)), 3))
    for name, other in (("deepcopy", copy.deepcopy(env)), ("pickle", pickle.loads(pickle.dumps(env)))):
        before = env.get_state()
        first = trial.path(other, start)
        require_same(env.get_state(), before, 0.0, f"the original of a {name}, after the copy was stepped")
        again = copy.deepcopy(env)
        require_same(trial.path(again, start), first, 0.0, f"a {name} and another copy")


def _check_set_state(env: SimulatorEnv, trial: _Trial, atol: float) -> None:
    trial.path(env, trial.reset(env, trial.theta(env)), 3)
    state = env.get_state()
    before = env.reset(state.clone(), set_state=True)
    first = trial.path(env, before, 2)
    trial.reset(env, trial.theta(env))
    second = trial.path(env, env.reset(state.clone(), set_state=True), 2)
    going = ~first["next", "done"].any(1)[:, 0]
    require_same(second[going], first[going], atol, "worlds that were put back")
    mask = torch.zeros(*env.batch_size, 1, dtype=torch.bool, device=env.device)
    mask[::2] = True
    now = trial.reset(env, trial.theta(env))
    after = env.reset(state.clone().update(now).set("_reset", mask), set_state=True)
    rows = mask[:, 0]
    for key in env.observation_spec.keys(True, True):
        require_same(
            TensorDict({"x": torch.where(rows.reshape(-1, *[1] * (after[key].ndim - 1)), before[key], now[key])}),
            TensorDict({"x": after[key]}),
            atol,
            f"{key!r} after some worlds were put back",
        )


def _check_wild(env: SimulatorEnv, trial: _Trial) -> None:
    start = trial.reset(env)
    action = env.rand_action(start.clone())["action"]
    if not action.dtype.is_floating_point:
        return
    action[0] = float("nan")
    after = env.step(start.set("action", action))["next"]
    for key in ("reward", *env.observation_spec.keys(True, True)):
        require(bool(after[key].isfinite().all()), f"{key!r} is not finite after an action that is no number")
    trial.reset(env)


def _ahead(data: TensorDictBase) -> TensorDictBase:
    """Return the last state of a path, to go on from; worlds that ended there are taken as going on."""
    return data[:, -1]["next"].exclude("reward", "done", "terminated", "truncated")
