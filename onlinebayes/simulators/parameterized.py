"""Any TorchRL environment with physical parameters: it reads theta at reset, for exactly the worlds that reset.

    def apply(env, values):
        env.unwrapped.l = values["length"]

    env = Parameterized(GymEnv("Pendulum-v1"), space, apply)
    env = TransformedEnv(env, ParameterRandomization(BoxUniform(space)))

| key         | shape                | meaning                                              |
|-------------|----------------------|------------------------------------------------------|
| ``"theta"`` | (*batch, P) float64  | parameters of each world, constant within an episode |

``apply`` sets the parameters in the environment behind the wrapper; it is called before that environment resets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from jaxtyping import Float
from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.data import Composite, TensorSpec, Unbounded
from torchrl.envs import EnvBase, Transform, TransformedEnv

from onlinebayes.parameters import ParameterSpace

Apply = Callable[[Any, Mapping[str, float]], None]
"""(environment, parameters by name) -> None: set them. The environment is the innermost one: Gymnasium's own for a
``GymWrapper``, dm_control's own for a ``DMControlWrapper``, else the ``EnvBase`` itself. Of a batched environment it is
the world that resets, where the environment keeps its worlds in a list ``envs``."""


class Parameterized(TransformedEnv):
    """An environment that takes theta at reset and carries it in every step.

    Args:
        env: any environment of batch size () or (n,).
        space: its parameters, in the order of theta.
        apply: see :data:`Apply`.
        nominal: theta (P,) of a world before it is given one; the middle of the bounds without it.
        theta_key: of the parameters.

    Raises:
        BadInput: at reset, a theta that is outside its bounds or no number.
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
        super().__init__(env, ReadTheta(space, apply, nominal=nominal, theta_key=theta_key))


class ReadTheta(Transform):
    """The transform behind :class:`Parameterized`; for environments that are put together by hand.

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
        self._nominal = middle if nominal is None else nominal.double()
        space.check(self._nominal)
        self._theta: Tensor | None = None

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase | None:
        parent = self.parent
        worlds = max(1, parent.batch_size.numel())
        if self._theta is None:
            self._theta = self._nominal.expand(worlds, -1).clone()
        reset = None if tensordict is None else tensordict.get("_reset", None)
        theta = None if tensordict is None else tensordict.get(self.theta_key, None)
        rows = list(range(worlds)) if reset is None else reset.reshape(worlds, -1).any(-1).nonzero()[:, 0].tolist()
        given = self._theta if theta is None else theta.reshape(worlds, -1).double().cpu()
        self.space.check(given[rows])
        self._theta = self._theta.index_copy(0, torch.tensor(rows, dtype=torch.long), given[rows])
        for row in rows:
            self._apply_to(_world(parent, row), dict(zip(self.space.names, given[row].tolist(), strict=True)))
        return tensordict if tensordict is None or theta is None else tensordict.exclude(self.theta_key)

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


def _world(env: EnvBase, row: int) -> Any:
    """The innermost environment behind a wrapper, or its world ``row``."""
    while isinstance(env, TransformedEnv):
        env = env.base_env
    inner = getattr(env, "_env", env)
    worlds = getattr(inner, "envs", None)
    return inner if worlds is None or not env.batch_size else worlds[row]


