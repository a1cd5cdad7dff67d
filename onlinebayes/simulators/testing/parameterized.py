"""Checks that every environment that reads theta must pass."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from tensordict import NestedKey, TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase, SerialEnv, check_env_specs

from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput, torch_threads_kept
from onlinebayes.simulators.testing.trials import require, require_same

_WORLDS = 3  # environments beside each other


@torch_threads_kept()
def check_parameterized(
    make_env: Callable[[], EnvBase],
    space: ParameterSpace,
    *,
    steps: int = 10,
    atol: float = 0.0,
    theta_key: NestedKey = "theta",
    seed: int = 0,
) -> None:
    """Raise AssertionError unless the environment reads theta at reset and carries it.

    Checked: TorchRL's ``check_env_specs``; theta of every world is what its last reset was given, through every step,
    and stays where a reset gives none; other parameters give another trajectory, the same parameters the same one;
    worlds that do not reset keep theta and go on as if nothing had been; several environments beside each other equal
    each alone; theta outside its bounds or no number is refused and leaves everything as it was.

    Args:
        make_env: a new environment; two of them with one seed behave alike.
        space: its parameters.
        steps: of the trajectories, fewer than an episode has.
        atol: how far an environment may be from its like.
        theta_key: of the parameters.
        seed: of environments, parameters and actions.

    Raises:
        ValueError: an episode ends within ``steps``.
    """
    check_env_specs(make_env(), seed=seed)
    env, trial = make_env(), _Trial(space, theta_key, steps, atol, seed)
    _check_spec(env, trial)
    _check_carried(env, trial)
    _check_acts(make_env, trial)
    _check_refused(env, trial)
    beside = SerialEnv(_WORLDS, make_env)
    _check_beside(beside, make_env, trial)
    _check_partial(beside, trial)
    if env.batch_size:
        _check_partial(env, trial)


class _Trial:
    """Parameters, actions and trajectories of the checks."""

    def __init__(self, space: ParameterSpace, key: NestedKey, steps: int, atol: float, seed: int) -> None:
        self.space, self.key, self.steps, self.atol, self.seed = space, key, steps, atol, seed
        self._generator = torch.Generator().manual_seed(seed)

    def theta(self, env: EnvBase) -> Float[Tensor, "*batch P"]:
        unit = torch.rand(*env.batch_size, len(self.space), generator=self._generator, dtype=torch.float64)
        return self.space.from_unit(unit).to(env.device or "cpu")

    def reset(self, env: EnvBase, theta: Tensor | None, mask: Tensor | None = None) -> TensorDictBase:
        given = TensorDict(batch_size=env.batch_size, device=env.device)
        if theta is not None:
            given.set(self.key, theta)
        if mask is not None:
            given.set("_reset", mask)
        return env.reset(given)

    def actions(self, env: EnvBase) -> list[Tensor]:
        with torch.random.fork_rng():
            torch.manual_seed(self.seed)
            return [env.rand_action(TensorDict(batch_size=env.batch_size))["action"] for _ in range(self.steps)]

    def walk(self, env: EnvBase, actions: list[Tensor]) -> TensorDict:
        """Step the worlds from where they stand, and return the results of the steps."""
        after = []
        for action in actions:
            step = env.step(TensorDict({"action": action}, batch_size=env.batch_size, device=env.device))["next"]
            after.append(step.double())
            if bool(step["done"].any()):
                raise ValueError(f"an episode ended after {len(after)} steps: give check_parameterized fewer steps")
        return TensorDict.stack(after, dim=len(env.batch_size))


def _check_spec(env: EnvBase, trial: _Trial) -> None:
    keys = env.full_observation_spec.keys(True, True)
    require(trial.key in keys, f"the observation spec has no {trial.key!r}, only {list(keys)}")
    shape = tuple(env.full_observation_spec[trial.key].shape)
    require(shape == (*env.batch_size, len(trial.space)), f"the spec of {trial.key!r} has shape {shape}")


def _check_carried(env: EnvBase, trial: _Trial) -> None:
    actions = trial.actions(env)
    for theta in (trial.theta(env), trial.theta(env)):
        for given in (theta, None):
            begin = trial.reset(env, given)
            after = trial.walk(env, actions)
            for found, where in ((begin, "after a reset"), (after[..., 0], "after a step"), (after[..., -1], "later")):
                _require_theta(
                    found[trial.key], theta, f"{where} that was given {'it' if given is not None else 'none'}"
                )


def _require_theta(found: Tensor, wanted: Tensor, where: str) -> None:
    require(bool(torch.equal(found.double(), wanted)), f"theta {where} is {found.tolist()}, not {wanted.tolist()}")


def _check_acts(make_env: Callable[[], EnvBase], trial: _Trial) -> None:
    paths = []
    env = make_env()
    thetas = trial.theta(env), trial.theta(env)
    actions = trial.actions(env)
    for theta in (thetas[0], thetas[0], thetas[1]):
        env = make_env()
        env.set_seed(trial.seed)
        trial.reset(env, theta)
        paths.append(trial.walk(env, actions).exclude(trial.key))
    require_same(paths[1], paths[0], trial.atol, "the same parameters twice")
    same = all(torch.equal(paths[2][key], paths[0][key]) for key in paths[0].keys(True, True))
    require(not same, "other parameters change nothing")


def _check_refused(env: EnvBase, trial: _Trial) -> None:
    theta = trial.theta(env)
    trial.reset(env, theta)
    for value in (float("nan"), float(trial.space.high[0]) + 1.0):
        wrong = theta.clone()
        wrong[..., 0] = value
        try:
            trial.reset(env, wrong)
        except BadInput:
            _require_theta(trial.reset(env, None)[trial.key], theta, "after a refusal")
            continue
        raise AssertionError(f"{trial.space.names[0]} = {value} was not refused with BadInput")


def _check_beside(beside: SerialEnv, make_env: Callable[[], EnvBase], trial: _Trial) -> None:
    theta, actions = trial.theta(beside), trial.actions(beside)
    beside.set_seed(trial.seed)
    trial.reset(beside, theta)
    together = trial.walk(beside, actions)
    _require_theta(together[trial.key].select(len(beside.batch_size), -1), theta, "of environments beside each other")
    seed = trial.seed
    for i in range(_WORLDS):
        env = make_env()
        seed = env.set_seed(seed)
        trial.reset(env, theta[i])
        alone = trial.walk(env, [action[i] for action in actions])
        require_same(together[i], alone, trial.atol, f"environment {i} of {_WORLDS} against the same one alone")


def _check_partial(env: EnvBase, trial: _Trial) -> None:
    old, new, actions = trial.theta(env), trial.theta(env), trial.actions(env)
    mask = torch.zeros(*env.batch_size, 1, dtype=torch.bool)
    mask.view(-1)[::2] = True
    kept = ~mask.squeeze(-1)
    paths = []
    for partial in (False, True):
        env.set_seed(trial.seed)
        trial.reset(env, old)
        trial.walk(env, actions[: trial.steps // 2])
        if partial:
            trial.reset(env, new, mask)
        paths.append(trial.walk(env, actions[trial.steps // 2 :]))
    wanted = torch.where(mask, new, old)
    _require_theta(paths[1][trial.key].select(len(env.batch_size), -1), wanted, "after a reset of some worlds")
    require_same(paths[1][kept], paths[0][kept], trial.atol, "worlds beside those that reset")
