"""Knowledge of a policy about its world so far: the embedding of the running episode, one step at a time.

    e_k, h_k = step(features(o_{k-1}, a_{k-1}, o_k), h_{k-1}),    h_0 = initial,    e_0 = 0

| key                          | shape  | meaning                                                                    |
|------------------------------|--------|----------------------------------------------------------------------------|
| ``("embedding", "vector")``  | (N, E) | e_k of the transitions of the episode up to this observation               |
| ``("embedding", "hidden")``  | (N, S) | h_k, apart from any hidden state of a policy, cleared where a world resets |

The inference loss trains the embedding on raw trajectories, and collectors run without gradients: the transform holds a
frozen copy, replaced with :meth:`TrajectoryEmbedding.set_embedding`.
"""

from __future__ import annotations

import copy
from typing import Protocol, cast, runtime_checkable

import torch
from tensordict import NestedKey, TensorDict, TensorDictBase
from torch import Tensor, nn
from torchrl.data import Composite, TensorSpec, Unbounded
from torchrl.envs import Transform

VECTOR, HIDDEN = ("embedding", "vector"), ("embedding", "hidden")


@runtime_checkable
class Stepwise(Protocol):
    """The interface of a stepwise embedding (a module; see ``onlinebayes.embeddings``).

    And ``features``, a module: observation, action, next observation (B, .) -> features (B, F) of single transitions.
    It cannot stand below: from Python 3.12 on ``isinstance`` does not see a module within a module.
    """

    size: int
    state_size: int

    def initial(self, batch: int, /) -> Tensor:
        """Hidden rows (B, S) before the first step."""
        ...

    def step(self, features: Tensor, state: Tensor, /) -> tuple[Tensor, Tensor]:
        """Vectors (B, E) after one more transition, and the hidden rows to carry on (B, S)."""
        ...


class TrajectoryEmbedding(Transform):
    """Carry the embedding of each world's running episode in the tensordict.

    In an environment it advances with every step. As a module or a buffer's transform (:meth:`forward`) it writes the
    same keys to recorded trajectories of batch size (..., T): it starts from the hidden row of the first step where
    one is recorded, starts anew where ``"is_init"`` says so, and stands still outside ``"mask"``.

    Args:
        embedding: a frozen copy of it is kept.
        observation_key, action_key: what it reads.
    """

    def __init__(
        self,
        embedding: Stepwise,
        *,
        observation_key: NestedKey = "observation",
        action_key: NestedKey = "action",
    ) -> None:
        super().__init__()
        self.observation_key, self.action_key = observation_key, action_key
        self.set_embedding(embedding)

    def set_embedding(self, embedding: Stepwise) -> None:
        """Keep a frozen copy of ``embedding`` from now on; hidden rows of running episodes are carried over."""
        self.embedding = copy.deepcopy(cast(nn.Module, embedding)).requires_grad_(False).eval()

    # --- environment --------------------------------------------------------------------------------------------

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        vector, hidden = self._advance(tensordict, next_tensordict, tensordict.get(HIDDEN))
        return next_tensordict.set(VECTOR, vector).set(HIDDEN, hidden)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        # Rows of worlds that do not reset are put back by the environment from what it was given.
        hidden = self._initial(tensordict_reset)
        return tensordict_reset.set(VECTOR, self._blank(hidden)).set(HIDDEN, hidden)

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        return next_tensordict

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Adds the two keys."""
        batch, device = observation_spec.shape, observation_spec.device
        hidden = self._module.initial(1)
        leaves = {
            name: Unbounded((*batch, width), dtype=hidden.dtype, device=device)
            for name, width in (("vector", self._module.size), ("hidden", self._module.state_size))
        }
        observation_spec["embedding"] = Composite(leaves, shape=batch, device=device)
        return observation_spec

    def transform_input_spec(self, input_spec: TensorSpec) -> TensorSpec:
        """The step needs the observation and the hidden row before it: environments of environments must pass them."""
        spec = self.parent.full_observation_spec
        state = input_spec["full_state_spec"]
        state[self.observation_key] = spec[self.observation_key].clone()
        state["embedding"] = Composite(
            hidden=Unbounded(
                (*state.shape, self._module.state_size), dtype=self._module.initial(1).dtype, device=state.device
            ),
            shape=state.shape,
            device=state.device,
        )
        return input_spec

    # --- recorded trajectories ----------------------------------------------------------------------------------

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the keys, at the root and under ``"next"``, for trajectories whose last batch dimension is time."""
        steps = tensordict.unbind(-1)
        hidden = steps[0].get(HIDDEN, None)
        hidden = self._initial(steps[0]) if hidden is None else hidden
        vector = steps[0].get(VECTOR, None)
        vector = self._blank(hidden) if vector is None else vector
        before, after = [], []
        for step in steps:
            start = step.get("is_init", None)
            if start is not None:
                start = start.reshape(*step.batch_size, 1)
                hidden = torch.where(start, self._initial(step), hidden)
                vector = torch.where(start, torch.zeros_like(vector), vector)
            before.append(_keys(vector, hidden, step))
            new_vector, new_hidden = self._advance(step, step.get("next"), hidden)
            mask = step.get("mask", None)
            if mask is not None:
                mask = mask.reshape(*step.batch_size, 1)
                new_vector, new_hidden = torch.where(mask, new_vector, vector), torch.where(mask, new_hidden, hidden)
            vector, hidden = new_vector, new_hidden
            after.append(_keys(vector, hidden, step))
        dim = tensordict.ndim - 1
        tensordict.set("embedding", torch.stack(before, dim))
        tensordict.set(("next", "embedding"), torch.stack(after, dim))
        return tensordict

    # --- both ---------------------------------------------------------------------------------------------------

    @property
    def _module(self) -> Stepwise:
        return cast(Stepwise, self.embedding)

    @torch.no_grad()
    def _advance(self, before: TensorDictBase, after: TensorDictBase, hidden: Tensor) -> tuple[Tensor, Tensor]:
        batch = before.batch_size
        observation, following = before.get(self.observation_key), after.get(self.observation_key)
        action = before.get(self.action_key).to(observation.dtype)
        rows = (x.reshape(batch.numel(), -1) for x in (observation, action, following))
        features = cast(nn.Module, self.embedding.features)(*rows)
        vector, hidden = self._module.step(features, hidden.reshape(batch.numel(), -1))
        return vector.reshape(*batch, -1), hidden.reshape(*batch, -1)

    def _initial(self, like: TensorDictBase) -> Tensor:
        return self._module.initial(like.batch_size.numel()).reshape(*like.batch_size, -1)

    def _blank(self, hidden: Tensor) -> Tensor:
        return hidden.new_zeros(*hidden.shape[:-1], self._module.size)


def _keys(vector: Tensor, hidden: Tensor, like: TensorDictBase) -> TensorDict:
    return TensorDict({"vector": vector, "hidden": hidden}, batch_size=like.batch_size, device=like.device)
