"""Embedding of trajectories under sensor noise: the place and the sharpness of a filter's likelihood peak in theta.

    z*, H = peak and information of  sum_i log p(y_i | theta(z))          (see ``likeliest``, ``kalman``)
    Sigma = (H + H_0)^-1 = L L^T,    z = z* + Sigma score
    e = [z, log diag L, L / diag(L) below it, log innovations],  then z and L as they are

The trajectories of a set are added before anything is looked at, so that their posterior is one density and no
product of many (Zaheer et al. 2017: a sum is the right form of a set's embedding; here it is exact). An estimator
reads z and L at the end of e as the place and scale about which it says what is left to say.

Nothing of this needs to be right: the estimator learns from simulations what e means. The noise r is read off the
simulations by :meth:`fit`, so that normalised innovations have mean square one.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from scipy.stats import qmc
from torch import Tensor

from onlinebayes.embeddings.base import SetEmbedding, check_padding
from onlinebayes.embeddings.features import RawTransitions
from onlinebayes.embeddings.kalman import Rows, SimulatorFilter
from onlinebayes.embeddings.likeliest import DISTURBED, Levels, climbed, likeliest
from onlinebayes.embeddings.standard import Standard

STARTS = 7
"""To climb from; the first is the centre of the box, and most climbs need no other."""

FLAT = 5.0
"""Standard deviation of z before anything was seen, H_0 = 1 / FLAT^2: a box is flat, but for .005 nats at its sides.
What trajectories say nothing of has to stay so."""

BEYOND = 0.5
"""Of the box: how far over its edge the likelihood's peak is looked for."""

FIRST_NOISE = 0.03
"""Of an observation's standard deviation: where the search for r begins."""

LEAST_NOISE = 1e-5
"""The same, at least: simulations without noise would ask for none."""

NOISE_ROUNDS, NOISE_SAMPLE, NOISE_STEPS = 4, 100, 4
"""Of that search; its trajectories; the most steps of its climbs at each level, few because their median counts."""

SCALE_SAMPLE = 200
"""Trajectories that tell the mean and spread of the vector."""


class FilteredEmbedding(SetEmbedding):
    """Trajectories of one system -> the likeliest theta, and how sure that is.

    Args:
        model: the filter.
        action: number of action values A.
        levels: how peaks are climbed; :data:`~onlinebayes.embeddings.likeliest.STRAIGHT` is quicker where it is enough.

    Attributes:
        model: as given; :meth:`fit` reads its noise and starts off simulations.
    """

    located = True
    starts: Tensor

    def __init__(self, model: SimulatorFilter, action: int, levels: Levels = DISTURBED) -> None:
        observation, P = model.observation, len(model.simulator.parameters)
        super().__init__(RawTransitions(observation, action))
        self.model, self._levels = model, levels
        self._told = P + P * (P + 1) // 2 + observation
        self.size = self._told + P + P * (P + 1) // 2
        starts = qmc.Sobol(P, scramble=False).random_base2(3)[1 : 1 + STARTS]
        self.register_buffer("starts", torch.from_numpy(starts))
        self.standard = Standard(self._told)
        self.to(model.noise.device)

    def scale(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> None:
        """Find the noise, then the mean and spread of what the filter gives."""
        model, rows = self.model, self.rows(features, mask)
        spread = rows.following[mask].std(0).clamp_min(1e-12)
        model.spread_over(rows.following[mask])
        model.noise.copy_(FIRST_NOISE * spread)
        some = Rows(*(part[:NOISE_SAMPLE] for part in rows))
        short, found = [(process, NOISE_STEPS) for process, _ in self._levels], None
        for _ in range(NOISE_ROUNDS):
            model.begin_at(rows.first)
            if found is None:
                found = likeliest(model, some, 1, self.starts[:1], short)
            else:  # the peaks stay nearly where they are: what was climbed is not climbed again
                found = climbed(model, some, 1, found.z, short[-1:])
            ratio = found.evidence.innovation.median(0).values
            model.noise.copy_((model.noise * ratio.sqrt()).clamp_min(LEAST_NOISE * spread))
        model.begin_at(rows.first)
        some_features, some_mask = features[:SCALE_SAMPLE, None], mask[:SCALE_SAMPLE, None]
        self.standard.fit(self._vector(some_features, some_mask)[:, : self._told])

    def encode_set(self, features: Float[Tensor, "G n T F"], mask: Bool[Tensor, "G n T"]) -> Float[Tensor, "G E"]:
        """Embed sets of trajectories made into rows before; see :meth:`SetEmbedding.encode_set`."""
        check_padding(mask.flatten(0, 1))
        vector = self._vector(features, mask)
        told = self.standard(vector[:, : self._told])
        told = torch.where(mask.flatten(1).any(1, keepdim=True), told, torch.zeros_like(told))
        return torch.cat([told, vector[:, self._told :]], dim=1).to(features.dtype)

    def rows(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Rows:
        """The filter's input from features."""
        rows, seen = features.double(), self.model.observation
        return Rows(rows[:, 0, :seen], rows[..., seen:-seen], rows[..., -seen:], mask)

    def _vector(self, features: Tensor, mask: Tensor) -> Float[Tensor, "G E"]:
        """Compute the embedding, not yet standardised, then z and L."""
        rows = self.rows(features.flatten(0, 1), mask.flatten(0, 1))
        found = likeliest(self.model, rows, mask.shape[1], self.starts, self._levels)
        P = found.z.shape[-1]
        H = found.evidence.information + torch.eye(P).to(found.z) / FLAT**2
        upper = torch.linalg.cholesky(H.flip(-1, -2)).flip(-1, -2)  # H = U U^T, U upper triangular
        L = torch.linalg.solve_triangular(upper.mT, torch.eye(P).to(H).expand_as(H), upper=False)
        # At an edge the score is not zero: the likelihood goes on beyond it.
        beyond = (L @ (L.mT @ found.evidence.score[..., None]))[..., 0]
        z = found.z + beyond.clamp(-BEYOND, BEYOND)
        diagonal = torch.diagonal(L, dim1=-2, dim2=-1)
        row, column = torch.tril_indices(P, P, offset=-1, device=L.device)
        shear = L[:, row, column] / diagonal[:, row]
        innovation = found.evidence.innovation.clamp_min(1e-12).log()
        row, column = torch.tril_indices(P, P, device=L.device)
        return torch.cat([z, diagonal.log(), shear, innovation, z, L[:, row, column]], dim=-1)
