"""Any TorchRL environment with physical parameters: it reads theta at reset, for exactly the worlds that reset.

    def apply(env, values):
        env.unwrapped.l = values["length"]

    env = Parameterized(GymEnv("Pendulum-v1"), space, apply)
    env = TransformedEnv(env, ParameterRandomization(BoxUniform(space)))

| key         | shape                | meaning                                              |
|-------------|----------------------|------------------------------------------------------|
| ``"theta"`` | (*batch, P) float64  | parameters of each world, constant within an episode |

``apply`` sets the parameters in the environment behind the wrapper, before that environment resets:

| environment                                   | ``apply`` gets                             | its values              |
|-----------------------------------------------|--------------------------------------------|-------------------------|
| ``GymWrapper``, ``GymEnv``                    | the Gymnasium environment                  | floats                  |
| ``DMControlWrapper``, ``DMControlEnv``        | the dm_control environment                 | floats                  |
| ``GymWrapper`` of a ``SyncVectorEnv``         | each world that resets, one after another  | floats                  |
| an ``EnvBase`` of your own, batch size ()     | itself                                     | floats                  |
| an ``EnvBase`` of your own, batch size (n,)   | itself, with the values of all worlds      | tensors (n,)            |

Several environments beside each other are each parameterised: ``SerialEnv(8, make)``, where ``make`` gives a
:class:`Parameterized`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import torch
from jaxtyping import Float
from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.data import Composite, TensorSpec, Unbounded
from torchrl.envs import (
    AutoResetTransform,
    Compose,
    EnvBase,
    Transform,
    TransformedEnv,
    VecGymEnvTransform,
)
from torchrl.envs.batched_envs import BatchedEnvBase

from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput

Apply = Callable[[Any, Mapping[str, Any]], None]
"""(environment, parameters by name) -> None: set them; the table above says which environment."""


class Parameterized(TransformedEnv):
    """An environment that takes theta at reset and carries it in every step.

    A world that is given no theta keeps the one it has.

    Args:
        env: any environment whose worlds wait for a reset when their episode has ended.
        space: its parameters, in the order of theta.
        apply: see :data:`Apply`. It sets all of them each time, and nothing that it set before must be left over.
        nominal: theta (P,) of a world before it is given one; the middle of the bounds without it.
        theta_key: of the parameters.

    Raises:
        BadInput: worlds that cannot be reached or that reset themselves, an environment that has ``theta_key``
            already; at reset, a theta that is outside its bounds or no number.
    """

    def __init__(
        self,
        env: EnvBase,
        space: ParameterSpace,
        apply: Apply,
        *,
        nominal: Float[Tensor, " P"] | None = None,
        theta_key: NestedKey = "theta",
    ) -> None:
        _check_reachable(env)
        if theta_key in env.full_observation_spec.keys(True, True):
            raise BadInput(
                f"{type(env).__name__} has {theta_key!r} already", "use it as it is, or choose another theta_key"
            )
        super().__init__(env, ReadTheta(space, apply, nominal=nominal, theta_key=theta_key))

    @property
    def inner(self) -> Any:
        """The environment behind all wrappers: Gymnasium's own, dm_control's own, or the ``EnvBase`` itself."""
        return _innermost(self)


class ReadTheta(Transform):
    """The transform behind :class:`Parameterized`.

    Args:
        space, apply, nominal, theta_key: as for :class:`Parameterized`.
    """

    def __init__(
        self,
        space: ParameterSpace,
        apply: Apply,
        *,
        nominal: Float[Tensor, " P"] | None = None,
        theta_key: NestedKey = "theta",
    ) -> None:
        super().__init__()
        self.space, self.theta_key, self._apply_to = space, theta_key, apply
        middle = space.from_unit(torch.full((len(space),), 0.5, dtype=torch.float64))
        self._nominal = middle if nominal is None else self._admitted(nominal)
        self._theta: Tensor | None = None

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase | None:
        parent = self.parent
        worlds = parent.batch_size.numel()
        now = self._nominal.expand(worlds, -1) if self._theta is None else self._theta
        rows = _resetting(parent, tensordict)
        given = None if tensordict is None else tensordict.get(self.theta_key, None)
        new = now[rows] if given is None else self._admitted(given.reshape(worlds, -1)[rows])
        self._theta = now.index_copy(0, torch.tensor(rows, dtype=torch.long), new)
        self._hand_over(parent, rows)
        rest = None if tensordict is None else tensordict.exclude(self.theta_key)
        return None if rest is None or rest.is_empty() else rest  # GymWrapper takes an empty one for a partial reset

    def _admitted(self, theta: Tensor) -> Tensor:
        """Theta in double precision, refused outside the bounds as its own precision has them."""
        theta = theta.detach().cpu()
        theta = theta if theta.is_floating_point() else theta.double()
        self.space.check(theta)
        return self.space.clamp(theta.double())

    def _hand_over(self, parent: EnvBase, rows: list[int]) -> None:
        """Call ``apply`` for the worlds that reset."""
        assert self._theta is not None
        inner = _innermost(parent)
        worlds = getattr(getattr(inner, "unwrapped", inner), "envs", None)
        if parent.batch_size and worlds is None:
            batched = self._theta.reshape(*parent.batch_size, -1).to(parent.device or "cpu")
            if rows:
                self._apply_to(inner, self.space.view(batched.clone()))
            return
        for row in rows:
            values = dict(zip(self.space.names, self._theta[row].tolist(), strict=True))
            self._apply_to(inner if worlds is None else worlds[row], values)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        return self._written(tensordict_reset)

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        return self._written(next_tensordict)

    def _written(self, tensordict: TensorDictBase) -> TensorDictBase:
        assert self._theta is not None
        theta = self._theta.reshape(*tensordict.batch_size, len(self.space)).to(tensordict.device or "cpu")
        return tensordict.set(self.theta_key, theta.clone())

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        return next_tensordict

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Adds theta."""
        observation_spec[self.theta_key] = self._spec(observation_spec)
        return observation_spec

    def transform_input_spec(self, input_spec: TensorSpec) -> TensorSpec:
        """Environments of environments pass on at reset what stands in the state spec."""
        state = input_spec["full_state_spec"]
        state[self.theta_key] = self._spec(state)
        return input_spec

    def _spec(self, like: Composite) -> Unbounded:
        return Unbounded((*like.shape, len(self.space)), dtype=torch.float64, device=like.device)


def _resetting(env: EnvBase, tensordict: TensorDictBase | None) -> list[int]:
    """The worlds that reset, all where no mask says otherwise."""
    worlds = env.batch_size.numel()
    masks = [] if tensordict is None else [tensordict.get(key, None) for key in env.reset_keys]
    chosen = [mask.reshape(worlds, -1).any(-1) for mask in masks if mask is not None]
    return torch.stack(chosen).any(0).nonzero()[:, 0].tolist() if chosen else list(range(worlds))


def _innermost(env: EnvBase) -> Any:
    """The environment behind all wrappers."""
    while isinstance(env, TransformedEnv):
        env = env.base_env
    return env.__dict__.get("_env", env)


def _check_reachable(env: EnvBase) -> None:
    """Refuse worlds that ``apply`` cannot set before they reset."""
    for transform in _transforms(env):
        if isinstance(transform, AutoResetTransform | VecGymEnvTransform):
            raise BadInput(
                "worlds that reset themselves start before they are given theta",
                "let TorchRL reset them: autoreset_mode=gymnasium.vector.AutoresetMode.DISABLED, or auto_reset=False",
            )
    inner = _innermost(env)
    if isinstance(inner, BatchedEnvBase) or hasattr(inner, "parent_pipes"):
        raise BadInput(
            f"the worlds of {type(inner).__name__} cannot be reached from outside",
            "parameterise each: SerialEnv(n, make) or ParallelEnv(n, make) where make gives a Parameterized",
        )


def _transforms(env: EnvBase) -> Iterator[Transform]:
    while isinstance(env, TransformedEnv):
        yield from env.transform if isinstance(env.transform, Compose) else (env.transform,)
        env = env.base_env
