"""Posteriors over physical parameters from trajectories: simulate, fit, condition, narrow, and again.

    proposal = BoxUniform(space)                                              # the prior
    for _ in range(rounds):
        simulated = simulate(proposal.sample((1000,)))                        # TensorDict (1000, T) with "theta"
        reference = SimulatorReference(simulator, proposal.box.cross(), ...)  # this and the next from .embeddings
        features = TransitionFeatures(4, 2, reference=reference, sensitivities=len(space))
        embedding = JoinedEmbedding([LSTMEmbedding(features), SummaryEmbedding(features, averages=False)])
        estimator = MixtureEstimator(space, embedding.size, box=proposal.box)
        loss = NeuralPosteriorLoss(embedding, estimator)
        fit(loss, simulated, generator=g, epochs=30)
        posterior = Posterior(loss).condition(real)                           # TensorDict (n, T): union over the n
        proposal = proposals.truncated(posterior, proposal, generator=g)      # where to simulate next

What comes out, and how to look at it (``from onlinebayes.inference import plots``, which loads matplotlib):

    posterior.log_prob(theta), posterior.sample((500,)), posterior.marginal(["mass"]), posterior.mean()
    plots.save(plots.corner(posterior, truth=theta, prior=BoxUniform(space)), "corner.png")
    saving.save(posterior, "pole.json"), saving.load("pole.json")
    print(identifiability(posterior, BoxUniform(space).box))                  # "Only mass/length is known ..."
    calibration.coverage(posterior.each, thetas, trajectories)                # each trajectory with a theta of its own
    changing = ChangingBelief(estimator).update(real)         # a machine that may have changed on the way: since when?
    trust.in_words(posterior.each, thetas, trajectories, space)              # coverage, ranks and TARP in two sentences

Every name is a part on its own; none knows of a trainer.
"""

from onlinebayes.inference import calibration, proposals, saving, trust
from onlinebayes.inference.alarm import Alarm, Novelty, Surprise
from onlinebayes.inference.base import Alarming, Belief, Density, FitReport, PosteriorEstimator
from onlinebayes.inference.changing import Change, ChangingBelief, History
from onlinebayes.inference.correction import Uncorrectable, corrected
from onlinebayes.inference.distributions import Box, BoxUniform, TruncatedMixture
from onlinebayes.inference.epsilon_free import EpsilonFree, EpsilonFreeRun, ProposalRound
from onlinebayes.inference.estimator import MixtureEstimator
from onlinebayes.inference.extension import extended
from onlinebayes.inference.filtered import filter_of, filtered_estimator
from onlinebayes.inference.fit import fit
from onlinebayes.inference.flow import FlowEstimator
from onlinebayes.inference.fourier import FourierFeatures
from onlinebayes.inference.gate import Decision, Gate
from onlinebayes.inference.identifiability import Identifiability, identifiability
from onlinebayes.inference.importance import WeightedDraws, importance
from onlinebayes.inference.length_scale import LengthScaleChoice, cross_validate, length_scales
from onlinebayes.inference.likelihood import LikelihoodEstimator, LikelihoodPosterior
from onlinebayes.inference.loss import NeuralPosteriorLoss
from onlinebayes.inference.neural import NeuralEstimator
from onlinebayes.inference.population import Population, PopulationABC
from onlinebayes.inference.posterior import Posterior
from onlinebayes.inference.rejection import RejectionABC
from onlinebayes.inference.residual import residual_estimator
from onlinebayes.inference.run_length import Hazard, RunLengths
from onlinebayes.inference.trajectories import TrajectoryKeys
from onlinebayes.inference.windowed import Windowed

__all__ = [
    "Alarm",
    "Alarming",
    "Belief",
    "Box",
    "BoxUniform",
    "Change",
    "ChangingBelief",
    "Decision",
    "Density",
    "EpsilonFree",
    "EpsilonFreeRun",
    "FitReport",
    "FlowEstimator",
    "FourierFeatures",
    "Gate",
    "Hazard",
    "History",
    "Identifiability",
    "LengthScaleChoice",
    "LikelihoodEstimator",
    "LikelihoodPosterior",
    "MixtureEstimator",
    "NeuralEstimator",
    "NeuralPosteriorLoss",
    "Novelty",
    "Population",
    "PopulationABC",
    "Posterior",
    "PosteriorEstimator",
    "ProposalRound",
    "RejectionABC",
    "RunLengths",
    "Surprise",
    "TrajectoryKeys",
    "TruncatedMixture",
    "Uncorrectable",
    "WeightedDraws",
    "Windowed",
    "calibration",
    "corrected",
    "cross_validate",
    "extended",
    "filter_of",
    "filtered_estimator",
    "fit",
    "identifiability",
    "importance",
    "length_scales",
    "proposals",
    "residual_estimator",
    "saving",
    "trust",
]
