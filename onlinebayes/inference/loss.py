"""Maximum likelihood of the parameters given their trajectories: neural posterior estimation.

    loss = - mean_b log q(theta_b | embedding(x_b)),    theta_b ~ proposal, x_b ~ simulator(theta_b)

Its minimum over q is the posterior under the proposal as a prior (Papamakarios and Murray 2016). A proposal that is
the prior *cut* to a region which holds the posterior's mass needs no correction: inside the region it is the prior up
to a constant, and outside there is nothing to correct (truncated sequential neural posterior estimation, Deistler,
Goncalves and Macke 2022). q is zero outside the proposal's box and normalised over it, in the loss as in use.

Embedding and estimator are trained together; the loss embeds raw trajectories anew at every call.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn

from onlinebayes.embeddings import Embedding, SetEmbedding
from onlinebayes.inference.base import ConditionalDensity
from onlinebayes.inference.distributions import TruncatedMixture
from onlinebayes.inference.lengths import Lengths
from onlinebayes.inference.trajectories import TrajectoryKeys, frame_of
from onlinebayes.runs import BadInput


class NeuralPosteriorLoss(TensorDictModuleBase):
    """Trajectories with their theta -> ``"loss_posterior"``, the mean negative log density in the box's coordinates.

    ``in_keys`` are those of ``keys`` (``"observation"``, ``"action"``, ``("next", "observation")``, ``"theta"``; and
    ``"mask"`` where there is one); ``out_keys`` is ``["loss_posterior"]``. In a trainer of your own call
    :meth:`standardise` on each round's trajectories before the first step: :func:`~onlinebayes.inference.fit` does it,
    a call of the loss does not.

    Args:
        embedding: trajectory -> vector; trained.
        estimator: vector -> density, an ``nn.Module``; trained.
        keys: where the trajectories lie in the TensorDict.
        whole_sets: learn from sets of all n trajectories only, for a use that always has as many; else from sets of
            one to n.
    """

    def __init__(
        self,
        embedding: Embedding,
        estimator: ConditionalDensity,
        keys: TrajectoryKeys | None = None,
        *,
        whole_sets: bool = False,
    ) -> None:
        super().__init__()
        self.whole_sets = whole_sets
        self.embedding, self.estimator = embedding, estimator
        self.keys = keys if keys is not None else TrajectoryKeys()
        self._learnt_from = Lengths(0, 0)
        self.in_keys = [self.keys.observation, self.keys.action, self.keys.following, self.keys.theta]
        self.out_keys = ["loss_posterior"]

    @property
    def weight(self) -> Tensor:
        """Some weight of the estimator: its dtype and device are the networks'."""
        return next(cast(nn.Module, self.estimator).parameters())

    def standardise(self, trajectories: TensorDictBase) -> None:
        """Fit the embedding's means and standard deviations on these trajectories."""
        trajectories = _single(trajectories)
        self._learnt_from = Lengths.of(self.keys.mask_of(trajectories))
        self.embedding.fit(*self.keys.read(self.keys.usable(trajectories), self.weight))

    def mind_lengths(self, trajectories: TensorDictBase) -> None:
        """Warn where trajectories (B, T), or those of sets (G, n, T), are much shorter or longer than the learnt ones.

        A located embedding's place and scale follow the length.
        """
        if not (isinstance(self.embedding, SetEmbedding) and self.embedding.located):
            self._learnt_from.warn(Lengths.of(self.keys.mask_of(_single(trajectories))))

    def prepare(self, trajectories: TensorDictBase) -> TensorDict:
        """Compute once, before training, all that depends on no weight: z of theta, and features with their mask.

        Where the embedding has no weights, its vectors stand in place of the features. Trajectories without a recorded
        step are left out; see :meth:`TrajectoryKeys.recorded`. Of sets (G, n, T) the first trajectory is read of the
        first set, two of the second, and so on up to n and again, unless whole sets are wanted.
        """
        if trajectories.ndim == 3:
            z = frame_of(self.keys.read_theta(trajectories[:, 0]), self.estimator.box).to(self.weight)
            features, mask = self._sets(trajectories)
            if not self.whole_sets:
                number = torch.arange(mask.shape[1], device=mask.device)
                size = torch.arange(len(mask), device=mask.device) % len(number) + 1
                mask = mask & (number < size[:, None])[..., None]
        else:
            trajectories = self.keys.usable(trajectories)
            *values, mask = self.keys.read(trajectories, self.weight)
            z = frame_of(self.keys.read_theta(trajectories), self.estimator.box).to(self.weight)
            features = self.embedding.features(*values)
        told = {"features": features, "mask": mask}
        if not any(True for _ in self.embedding.parameters()):
            told = {"embedding": self._encoded(features, mask)}
        return TensorDict({**told, "z": z}, batch_size=[z.shape[0]])

    def embed(self, trajectories: TensorDictBase) -> Float[Tensor, "B E"]:
        """Vectors of single trajectories (B, T), or of sets (B, n, T).

        Raises:
            BadInput: sets, for an embedding of single trajectories.
        """
        if trajectories.ndim == 3:
            return self._encoded(*self._sets(trajectories))
        *values, mask = self.keys.read(trajectories, self.weight)
        return self.embedding(*values, mask)

    def _sets(self, groups: TensorDictBase) -> tuple[Float[Tensor, "G n T F"], Bool[Tensor, "G n T"]]:
        """Features and mask of sets of trajectories."""
        if not isinstance(self.embedding, SetEmbedding):
            raise BadInput(
                f"sets of trajectories {tuple(groups.shape)} for {type(self.embedding).__name__}",
                "embeds one at a time: give trajectories (B, T), or an embedding of sets",
            )
        size = groups.shape[:2]
        *values, mask = self.keys.read(groups.flatten(0, 1), self.weight, of_sets=True)
        features, mask = self.embedding.features(*values).unflatten(0, size), mask.unflatten(0, size)
        empty = ~mask.any(-1).any(-1)
        if bool(empty.any()):
            raise BadInput(f"no trajectory of set {int(empty.nonzero()[0])} has a recorded step", "leave the set out")
        return features, mask

    def _encoded(self, features: Tensor, mask: Tensor) -> Float[Tensor, "B E"]:
        """Vectors of features made before, of single trajectories or of sets."""
        if mask.ndim == 3:
            return cast(SetEmbedding, self.embedding).encode_set(features, mask)
        return self.embedding.encode(features, mask)

    def get_extra_state(self) -> dict[str, Any]:
        """The box that the weights speak of, and the lengths of the trajectories behind them."""
        box = self.estimator.box
        return {
            "names": list(box.space),
            "box": torch.stack((box.low, box.high)),
            "lengths": list(self._learnt_from),
        }

    def set_extra_state(self, state: Mapping[str, Any]) -> None:
        """Refuse weights of another box: z would mean another theta."""
        own = self.get_extra_state()
        if state["names"] != own["names"] or not torch.equal(state["box"].cpu(), own["box"].cpu()):
            raise BadInput(
                f"the weights were trained over {state['names']} in the box {state['box'].tolist()}, not over"
                f" {own['names']} in {own['box'].tolist()}",
                "build the estimator in that box",
            )
        self._learnt_from = Lengths(*state.get("lengths", (0, 0)))

    def each(self, prepared: Mapping[str, Tensor] | TensorDictBase, *, exact: bool = True) -> Float[Tensor, " B"]:
        """The loss of each row that :meth:`prepare` made.

        Args:
            prepared: the rows.
            exact: whether a mixture's mass in its box is integrated. Else the mass along one axis stands in its place:
                the loss is an upper bound, much faster, and exact for one parameter.
        """
        embedding = prepared.get("embedding", None)
        if embedding is None:
            embedding = self._encoded(prepared["features"], prepared["mask"])
        density = self.estimator.distribution(embedding)
        if not exact and isinstance(density, TruncatedMixture):
            return -density.log_prob_bound(prepared["z"])
        return -density.log_prob_frame(prepared["z"])

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """The mean loss over the batch, a scalar on ``"loss_posterior"``."""
        return TensorDict({"loss_posterior": self.each(self.prepare(tensordict)).mean()})


def _single(trajectories: TensorDictBase) -> TensorDictBase:
    """Trajectories (B, T): those of sets (G, n, T) one after the other."""
    return cast(TensorDictBase, trajectories.flatten(0, 1)) if trajectories.ndim == 3 else trajectories
