"""Transforms of TorchRL environments: draw physics at reset, add sensor noise, embed what has been seen."""

from onlinebayes.transforms.embedding import Stepwise, TrajectoryEmbedding
from onlinebayes.transforms.noise import SensorNoise
from onlinebayes.transforms.randomization import Distribution, ParameterRandomization

__all__ = ["Distribution", "ParameterRandomization", "SensorNoise", "Stepwise", "TrajectoryEmbedding"]
