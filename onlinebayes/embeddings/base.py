"""The interface of embeddings: trajectory -> vector, at once or step by step, blind to padding."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from onlinebayes.embeddings.features import RawTransitions, TransitionFeatures


class Embedding(nn.Module, ABC):
    """Trajectory -> vector e (B, E).

    Args:
        features: what is told about each transition; a part of the embedding's state.

    Attributes:
        size: length E of the vector.
    """

    size: int
    _like: Tensor

    def __init__(self, features: TransitionFeatures | RawTransitions) -> None:
        super().__init__()
        self.features = features
        # Follows the module's dtype and device, for modules without weights too.
        self.register_buffer("_like", torch.empty(0), persistent=False)

    @property
    def device(self) -> torch.device:
        """The device of the embedding."""
        return self._like.device

    def forward(
        self,
        observation: Float[Tensor, "B T O"],
        action: Float[Tensor, "B T A"],
        following: Float[Tensor, "B T O"],
        mask: Bool[Tensor, "B T"] | None = None,
    ) -> Float[Tensor, "B E"]:
        """Embed whole trajectories.

        Args:
            observation: o_t.
            action: a_t.
            following: the observation after it, o_{t+1}.
            mask: False in the padding at the end, which may hold anything, NaN too; all True when absent.
        """
        if mask is None:
            mask = torch.ones(observation.shape[:2], dtype=torch.bool, device=observation.device)
        values = [cleared(x, mask) for x in (observation, action, following)]
        return self.encode(self.features(*values), mask)

    def fit(
        self,
        observation: Float[Tensor, "B T O"],
        action: Float[Tensor, "B T A"],
        following: Float[Tensor, "B T O"],
        mask: Bool[Tensor, "B T"],
    ) -> None:
        """Standardise the features, and whatever else is scaled, on these trajectories."""
        self.features.fit(observation, action, following, mask)
        values = [cleared(x, mask) for x in (observation, action, following)]
        self.scale(self.features(*values), mask)

    @abstractmethod
    def scale(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> None:
        """Fit what is scaled behind the features; nothing where there is nothing."""

    @abstractmethod
    def encode(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B E"]:
        """Embed features made before; zeros for a trajectory without a recorded step.

        Raises:
            ValueError: a mask with a gap, a recorded step behind a padded one.
        """


class SetEmbedding(Embedding):
    """An embedding of several trajectories of one system at once, in whatever order: a single one is a set of one.

    Attributes:
        located: whether e ends with a place z (P) and a scale L (the lower triangle, row by row) in the box's
            coordinates, about which an estimator speaks.
    """

    located: bool = False

    @abstractmethod
    def encode_set(self, features: Float[Tensor, "G n T F"], mask: Bool[Tensor, "G n T"]) -> Float[Tensor, "G E"]:
        """Embed sets of features made before; a trajectory without a recorded step says nothing.

        Raises:
            ValueError: a mask with a gap, a recorded step behind a padded one.
        """

    def encode(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B E"]:
        """Embed sets of one."""
        return self.encode_set(features.unsqueeze(1), mask.unsqueeze(1))


class StepwiseEmbedding(Embedding):
    """An embedding that can also follow a trajectory while it is made, step by step, equal to the whole.

    Attributes:
        state_size: length S of the hidden row that :meth:`step` carries.
    """

    state_size: int

    def initial(self, batch: int) -> Float[Tensor, "B S"]:
        """The hidden rows before the first step: zeros."""
        return torch.zeros(batch, self.state_size, dtype=self._like.dtype, device=self._like.device)

    @abstractmethod
    def step(
        self, features: Float[Tensor, "B F"], state: Float[Tensor, "B S"]
    ) -> tuple[Float[Tensor, "B E"], Float[Tensor, "B S"]]:
        """The vectors after one more transition, and the hidden rows to carry on.

        Args:
            features: ``embedding.features(observation, action, next_observation)`` of this step.
            state: hidden rows, from :meth:`initial` or from the last step.
        """


def cleared(values: Float[Tensor, "*batch F"], mask: Bool[Tensor, "*batch"]) -> Float[Tensor, "*batch F"]:
    """``values`` with zeros outside ``mask``; a product would keep the padding's NaN and give NaN gradients."""
    return torch.where(mask.unsqueeze(-1), values, torch.zeros((), dtype=values.dtype, device=values.device))


def last_and_mean(outputs: Float[Tensor, "B T H"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B E"]:
    """Each row's output at its own last step, and the mean over its steps; zeros where it has none."""
    count = mask.sum(1)
    row = torch.arange(len(outputs), device=outputs.device)
    last = outputs[row, (count - 1).clamp(min=0)] * (count > 0).unsqueeze(-1)
    mean = (outputs * mask.unsqueeze(-1)).sum(1) / count.clamp(min=1).unsqueeze(-1)
    return torch.cat([last, mean], dim=-1)


def check_padding(mask: Bool[Tensor, "B T"]) -> None:
    """Raise ``ValueError`` where a recorded step stands behind a padded one."""
    if bool((mask[:, 1:] & ~mask[:, :-1]).any()):
        raise ValueError("a recorded step stands behind a padded one; move the padding to the end")
