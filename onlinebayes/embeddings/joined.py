"""Several embeddings side by side: e = [e_1, e_2, ...], over the same features."""

from __future__ import annotations

from collections.abc import Iterable
from typing import cast

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from onlinebayes.embeddings.base import StepwiseEmbedding


class JoinedEmbedding(StepwiseEmbedding):
    """The vectors of several embeddings, one behind the other.

    Args:
        members: embeddings built over one features object.

    Raises:
        ValueError: no member, or members over different features.
    """

    def __init__(self, members: Iterable[StepwiseEmbedding]) -> None:
        members = tuple(members)
        if not members or any(member.features is not members[0].features for member in members):
            raise ValueError("join at least one embedding, all built over the same features object")
        super().__init__(members[0].features)
        self.members = nn.ModuleList(members)
        self.size = sum(member.size for member in members)
        self.state_size = sum(member.state_size for member in members)

    def scale(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> None:
        """Fit the scales of every member."""
        for member in self._members():
            member.scale(features, mask)

    def encode(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B E"]:
        """Embed features made before; see :meth:`Embedding.encode`."""
        return torch.cat([member.encode(features, mask) for member in self._members()], dim=-1)

    def step(
        self, features: Float[Tensor, "B F"], state: Float[Tensor, "B S"]
    ) -> tuple[Float[Tensor, "B E"], Float[Tensor, "B S"]]:
        """One more transition; see :meth:`StepwiseEmbedding.step`."""
        parts = state.split([member.state_size for member in self._members()], dim=-1)
        results = [member.step(features, part) for member, part in zip(self._members(), parts, strict=True)]
        return torch.cat([r[0] for r in results], dim=-1), torch.cat([r[1] for r in results], dim=-1)

    def _members(self) -> list[StepwiseEmbedding]:
        return [cast(StepwiseEmbedding, member) for member in self.members]
