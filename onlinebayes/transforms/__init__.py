"""Transforms of TorchRL environments: draw physics at reset, embed what has been seen."""

from onlinebayes.transforms.embedding import StepwiseEmbedding, TrajectoryEmbedding
from onlinebayes.transforms.randomization import Distribution, ParameterRandomization

__all__ = ["Distribution", "ParameterRandomization", "StepwiseEmbedding", "TrajectoryEmbedding"]
