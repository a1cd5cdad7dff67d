"""Every episode in a world of its own: theta is drawn where worlds reset and stays until they reset again.

    theta_i ~ p   for exactly the worlds i that reset and are given none,    theta_i constant within an episode

TorchRL hides everything but the reset mask from an environment that resets itself (issue #1465 of pytorch/rl), so the
draw happens before the environment's own reset and reaches it on the leaf ``"theta"``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Int
from tensordict import NestedKey, TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase, Transform, TransformedEnv

from onlinebayes.runs import BadInput, worker_seed
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

    A theta that a reset is given stays, and nothing is drawn for its world: ``env.reset(TensorDict(theta=theta))``. In
    a partial reset the theta that a world has already counts as carried along, not as given, and is drawn anew.

    Draws come from torch's global random numbers, until ``set_seed`` of a ``SimulatorEnv`` is given a seed; from then
    on they are decided by it alone. In a worker process without such a seed they come from numbers of the worker's
    own, for workers share the global ones; not so in a spawned process that called ``torch.manual_seed``.

    Args:
        distribution: where theta comes from; replaceable with :meth:`set_distribution`, which takes effect world by
            world as they reset.
        theta_key: of the parameters.

    Raises:
        BadInput: the environment below does not read theta, at the first reset.
    """

    def __init__(self, distribution: Distribution, *, theta_key: NestedKey = "theta") -> None:
        super().__init__()
        self._distribution, self.theta_key = distribution, theta_key
        self._seeding: tuple[int, int] | None = None
        self._random: Tensor | None = None
        self._on_gpu: Tensor | None = None
        self._present: Tensor | None = None
        self._checked = False

    @property
    def distribution(self) -> Distribution:
        """The distribution that theta is drawn from now."""
        return self._distribution

    def set_distribution(self, distribution: Distribution) -> None:
        """Draw from another distribution from the next reset on."""
        self._distribution = distribution

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write a fresh draw for every element."""
        return tensordict.set(self.theta_key, self._draw(tensordict.numel()).reshape(*tensordict.batch_size, -1))

    def get_extra_state(self) -> dict[str, Any]:
        """State of the random numbers that a seed decides, or None, the seed that they follow, theta of the worlds."""
        return {"random": self._random, "gpu": self._on_gpu, "seeding": self._seeding, "theta": self._present}

    def set_extra_state(self, state: Mapping[str, Any]) -> None:
        """Draw on from there."""
        random, gpu, seeding = state["random"], state.get("gpu"), state["seeding"]
        self._random, self._on_gpu = (None if each is None else each.cpu() for each in (random, gpu))
        self._present = state.get("theta")
        self._seeding = None if seeding is None else tuple(seeding)

    def _draw(self, number: int) -> Tensor:
        with torch.no_grad():
            if self._random is None and (seed := worker_seed()) is not None:
                self._random = _random_state(seed)
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
        batch, given = tensordict.batch_size, tensordict.get(self.theta_key, None)
        rows = self._without_theta(tensordict, given)
        if given is not None and not len(rows):
            return tensordict
        drawn = self._draw(len(rows)).to(rows.device)
        if len(rows) < batch.numel():
            base = drawn.new_zeros(batch.numel(), drawn.shape[-1])
            base = base if given is None else given.reshape(base.shape).to(drawn)
            drawn = base.index_copy(0, rows, drawn)
        return tensordict.set(self.theta_key, drawn.reshape(*batch, drawn.shape[-1]))

    def _without_theta(self, tensordict: TensorDictBase, given: Tensor | None) -> Int[Tensor, " n"]:
        """The worlds that reset and are given no theta, but at most the one that they have."""
        worlds, reset = tensordict.batch_size.numel(), tensordict.get("_reset", None)
        if reset is None:
            return torch.arange(worlds if given is None else 0, device=tensordict.device)
        reset = reset.reshape(worlds, -1).any(-1)
        if given is not None:
            present = self._present if self._present is not None else torch.full_like(given, torch.nan)
            reset = reset & (given.reshape(present.shape) == present.to(given)).all(-1).reshape(worlds)
        return reset.nonzero().squeeze(-1)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        if not self._checked:
            self._check_read(tensordict, tensordict_reset)
            self._checked = True
        reset, now = tensordict.get("_reset", None), tensordict_reset.get(self.theta_key)
        now = now.reshape(now.shape[:-1].numel(), now.shape[-1])  # theta may be of no parameters
        if reset is not None and self._present is not None:
            now = torch.where(reset.reshape(len(now), -1).any(-1, keepdim=True), now, self._present.to(now))
        self._present = now.clone()
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
