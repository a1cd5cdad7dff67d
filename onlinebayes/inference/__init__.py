"""Posteriors over physical parameters from trajectories.

prior = BoxUniform(space)                                              # theta = prior.sample((1000,))
features = TransitionFeatures(observation=4, action=2)                 # onlinebayes.embeddings
embedding = LSTMEmbedding(features)
estimator = MixtureEstimator(space, embedding.size)
loss = NeuralPosteriorLoss(embedding, estimator)

fit(loss, simulated, generator=g, seconds=8)                           # TensorDict (B, T) with "theta"
posterior = Posterior(loss).condition(real)                            # TensorDict (n, T): union over the n
posterior.log_prob(theta), posterior.sample((500,)), posterior.mean()

proposal = proposals.truncated(posterior, generator=g)                 # theta = proposal.sample((1000,))
estimator.box = proposal.box                                           # next round: simulate there, fit again
"""

from onlinebayes.inference import proposals
from onlinebayes.inference.distributions import Box, BoxUniform, TruncatedMixture
from onlinebayes.inference.estimator import MixtureEstimator
from onlinebayes.inference.fit import FitReport, fit
from onlinebayes.inference.loss import NeuralPosteriorLoss
from onlinebayes.inference.posterior import Posterior
from onlinebayes.inference.trajectories import TrajectoryKeys

__all__ = [
    "Box",
    "BoxUniform",
    "FitReport",
    "MixtureEstimator",
    "NeuralPosteriorLoss",
    "Posterior",
    "TrajectoryKeys",
    "TruncatedMixture",
    "fit",
    "proposals",
]
