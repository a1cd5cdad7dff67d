"""Every episode in a world of its own: theta is drawn where worlds reset and stays until they reset again.

    theta_i ~ p   for exactly the worlds i that reset,    theta_i constant within an episode

TorchRL hides everything but the reset mask from an environment that resets itself (issue #1465 of pytorch/rl), so the
draw happens before the environment's own reset and reaches it on the leaf ``"theta"``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol, runtime_checkable

import torch
from tensordict import NestedKey, TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase, Transform, TransformedEnv

from onlinebayes.runs import BadInput
from onlinebayes.simulators import SimulatorEnv


@runtime_checkable
class Distribution(Protocol):
    """Anything to draw parameters from: priors, posteriors, proposals."""

    def sample(self, shape: tuple[int, ...], /) -> Tensor:
        """Draws of shape (*shape, P) [SI]."""
        ...


class ParameterRandomization(Transform):
    """Draw theta for the worlds that reset.

    The environment below must read theta in its reset and carry it in every step, as ``SimulatorEnv`` and
    ``Parameterized`` do. As a module (:meth:`forward`) it writes a fresh draw for every element of a tensordict.

    Draws come from torch's global random numbers, until there is a seed: ``seed``, or the one that ``set_seed`` of a
    ``SimulatorEnv`` is given. From then on they are decided by that seed alone.

    Args:
        distribution: where theta comes from; replaceable with :meth:`set_distribution`, which takes effect world by
            world as they reset.
        theta_key: of the parameters.
        seed: of the draws.

    Raises:
        BadInput: the environment below does not read theta, at the first reset.
    """

    def __init__(self, distribution: Distribution, *, theta_key: NestedKey = "theta", seed: int | None = None) -> None:
        super().__init__()
        self._distribution, self.theta_key = distribution, theta_key
        self._seeding: tuple[int, int] | None = None
        self._random = None if seed is None else _random_state(seed)
        self._on_gpu: Tensor | None = None
        self._checked = False

    @property
    def distribution(self) -> Distribution:
        """Where theta comes from now."""
        return self._distribution

    def set_distribution(self, distribution: Distribution) -> None:
        """Draw from another distribution from the next reset on."""
        self._distribution = distribution

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write a fresh draw for every element."""
        return tensordict.set(self.theta_key, self._draw(tensordict.numel()).reshape(*tensordict.batch_size, -1))

    def get_extra_state(self) -> dict[str, Any]:
        """State of the random numbers that a seed decides, None without one, and the environment's seed they follow."""
        return {"random": self._random, "gpu": self._on_gpu, "seeding": self._seeding}

    def set_extra_state(self, state: Mapping[str, Any]) -> None:
        """Draw on from there."""
        random, gpu, seeding = state["random"], state.get("gpu"), state["seeding"]
        self._random, self._on_gpu = (None if each is None else each.cpu() for each in (random, gpu))
        self._seeding = None if seeding is None else tuple(seeding)

    def _draw(self, number: int) -> Tensor:
        with torch.no_grad():
            if self._random is None:
                return self._distribution.sample((number,))
            with self._seeded(self._random):
                return self._distribution.sample((number,))

    @contextmanager
    def _seeded(self, random: Tensor) -> Iterator[None]:
        """Torch's random numbers as the seed has them, also those of a GPU that a distribution may lie on."""
        outside, outside_on_gpu = torch.get_rng_state(), _gpu_state()
        try:
            torch.set_rng_state(random)
            if self._on_gpu is not None and outside_on_gpu is not None:
                torch.cuda.set_rng_state(self._on_gpu)
            elif outside_on_gpu is not None:
                torch.cuda.manual_seed(torch.initial_seed())
            yield
            self._random, self._on_gpu = torch.get_rng_state(), _gpu_state()
        finally:
            torch.set_rng_state(outside)
            if outside_on_gpu is not None:
                torch.cuda.set_rng_state(outside_on_gpu)

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        return next_tensordict

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase:
        parent = self.parent
        self._look_at(parent)
        if tensordict is None:
            tensordict = TensorDict(batch_size=parent.batch_size, device=parent.device)
        batch = tensordict.batch_size
        reset = tensordict.get("_reset", None)
        if reset is None:
            return tensordict.set(self.theta_key, self._draw(batch.numel()).reshape(*batch, -1))
        rows = reset.reshape(-1).nonzero().squeeze(-1)
        drawn = self._draw(len(rows)).to(reset.device)
        theta = drawn.new_zeros(batch.numel(), drawn.shape[-1]).index_copy_(0, rows, drawn)
        return tensordict.set(self.theta_key, theta.reshape(*batch, -1))

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        if not self._checked:
            self._check_read(tensordict, tensordict_reset)
            self._checked = True
        return tensordict_reset

    def _look_at(self, parent: EnvBase) -> None:
        """Refuse an environment that has no theta; follow the seed of one that says it."""
        base = _base(parent)
        if not self._checked and self.theta_key not in parent.full_observation_spec.keys(True, True):
            raise self._unread(base)
        seeding = base.seeding if isinstance(base, SimulatorEnv) else None
        if seeding is not None and seeding != self._seeding:
            self._random, self._on_gpu, self._seeding = _random_state(seeding[0]), None, seeding

    def _check_read(self, told: TensorDictBase, after: TensorDictBase) -> None:
        """Refuse an environment that has theta and does not take it; ours takes it unless a state holds another."""
        base = _base(self.parent)
        if isinstance(base, SimulatorEnv):
            return
        reset, drawn = told.get("_reset", None), told.get(self.theta_key)
        taken = after.get(self.theta_key).to(drawn)
        rows = ... if reset is None else reset.reshape(drawn.shape[:-1])
        if not torch.allclose(taken[rows], drawn[rows], rtol=1e-5):
            raise self._unread(base)

    def _unread(self, env: EnvBase) -> BadInput:
        return BadInput(
            f"{type(env).__name__} does not read {self.theta_key!r} at reset: nothing would be randomised",
            "wrap it with onlinebayes.simulators.Parameterized, or use a SimulatorEnv",
        )


def _base(env: EnvBase) -> EnvBase:
    """The environment below all transforms."""
    while isinstance(env, TransformedEnv):
        env = env.base_env
    return env


def _gpu_state() -> Tensor | None:
    """State of the random numbers of the GPU in use; None where none was used so far."""
    return torch.cuda.get_rng_state() if torch.cuda.is_initialized() else None


def _random_state(seed: int) -> Tensor:
    """State of torch's random numbers right after that seed."""
    return torch.Generator().manual_seed(seed).get_state()
