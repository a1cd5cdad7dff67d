"""The posterior of a model's parameters given a log: a distribution, in place of one fitted value.

found = posterior_of_log(simulator, measurement)
found.belief.sample((64,)), found.parameters["body.bob.mass"].sd, found.identifiability
write_posterior([found], "out/posterior")
"""

from onlinebayes.posterior import words
from onlinebayes.posterior.infer import posterior_of_log
from onlinebayes.posterior.results import LogPosterior, Method, ParameterBelief, Reproduction
from onlinebayes.posterior.words import lines, side_by_side
from onlinebayes.posterior.write import MOST_MODELS, corner_plots, names_of, write_posterior

__all__ = [
    "MOST_MODELS",
    "LogPosterior",
    "Method",
    "ParameterBelief",
    "Reproduction",
    "corner_plots",
    "lines",
    "names_of",
    "posterior_of_log",
    "side_by_side",
    "words",
    "write_posterior",
]
