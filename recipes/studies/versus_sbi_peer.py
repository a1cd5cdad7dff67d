"""The inference that a user of sbi would write: NPE with one of its densities, on our features or the raw trajectory.

| method        | x                                                                     | before the density          |
|---------------|-----------------------------------------------------------------------|-----------------------------|
| mdn, maf, nsf | our summary of the trajectory                                         | nothing                     |
| ... raw       | all observations and actions in a row, zeros after a trajectory's end | a fully connected embedding |

Everything else is sbi's default: batches of 200, learning rate 5e-4, a tenth held out, 20 epochs of patience, whitened
parameters and inputs, draws outside the prior rejected, densities corrected for what leaks out of it.
"""

from __future__ import annotations

from tempfile import TemporaryDirectory

import torch
from sbi.inference import NPE
from sbi.inference.posteriors.direct_posterior import DirectPosterior
from sbi.neural_nets import posterior_nn
from sbi.neural_nets.embedding_nets import FCEmbedding
from sbi.utils import BoxUniform
from sbi.utils.tracking import TensorBoardTracker
from tensordict import TensorDict
from torch import Tensor
from torch.utils.tensorboard import SummaryWriter

from onlinebayes.parameters import ParameterSpace

LEAKAGE = 1000
"""Draws by which is found what leaks out of the prior, for each of the held-out trajectories."""


def raw(trajectories: TensorDict) -> Tensor:
    """x (B, .) of trajectories (B, T)."""
    mask = trajectories["mask"].unsqueeze(-1)
    told = [trajectories["observation"], trajectories["action"], trajectories["next", "observation"]]
    first, action, after = (torch.where(mask, values.float(), 0.0) for values in told)
    return torch.cat([first[:, 0], action.flatten(1), after.flatten(1)], dim=-1)


def fitted(method: str, space: ParameterSpace, theta: Tensor, x: Tensor) -> DirectPosterior:
    """NPE trained on theta (B, P) and x (B, X)."""
    density, _, inputs = method.partition(" ")
    prior = BoxUniform(space.low.float(), space.high.float())
    network = posterior_nn(density, embedding_net=FCEmbedding(x.shape[1])) if inputs else density
    with TemporaryDirectory() as place:  # sbi would leave its curves in the folder that it is called from
        tracker = TensorBoardTracker(SummaryWriter(place))
        inference = NPE(prior=prior, density_estimator=network, tracker=tracker, show_progress_bars=False)
        inference.append_simulations(theta.float(), x).train()
        return inference.build_posterior()


class Each:
    """sbi's posteriors given x (B, X) as a batch, each with draws of its network, of which some lie outside the prior.

    sbi draws until enough lie inside, for hours where a network has put next to nothing there. Here a posterior has
    the same number of draws, and what leaks out of the prior is their share outside.

    Args:
        posterior: of NPE.
        x: what each is conditioned on.

    Attributes:
        inside: share of each network's draws inside the prior (B,), at least one of them.
    """

    def __init__(self, posterior: DirectPosterior, x: Tensor) -> None:
        self._posterior, self._x = posterior, x
        drawn = posterior.sample_batched((LEAKAGE,), x, show_progress_bars=False, reject_outside_prior=False)
        self._densities = self._log_prob(drawn)
        self.inside = torch.isfinite(self._densities).float().mean(0).clamp(min=1 / LEAKAGE)

    def log_prob(self, theta: Tensor) -> Tensor:
        """Log density of one theta each (B, P), corrected for what leaks out."""
        return self._log_prob(theta[None])[0] - self.inside.log()

    def credibility(self, theta: Tensor) -> Tensor:
        """Return each posterior's credibility of the smallest region with theta on its edge; 1 if no draw is inside."""
        denser = (self._densities >= self._log_prob(theta[None])) & torch.isfinite(self._densities)
        share = denser.float().mean(0) / self.inside
        return torch.where(torch.isfinite(self._densities).any(0), share, 1.0)

    def _log_prob(self, theta: Tensor) -> Tensor:
        """Log density (S, B) of the networks, -inf outside the prior."""
        return self._posterior.log_prob_batched(theta.float(), self._x, norm_posterior=False)
