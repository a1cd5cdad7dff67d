"""Trajectory -> vector: plain masked modules, without knowledge of priors or policies.

    reference = SimulatorReference(simulator, proposal.box.cross(), state=..., command=..., observe=...)
    features = TransitionFeatures(observation=4, action=2, reference=reference, sensitivities=2)
    embedding = JoinedEmbedding([LSTMEmbedding(features), SummaryEmbedding(features)])
    embedding.fit(observation, action, following, mask)  # once a round: standardisation (inference.fit does it)
    vector = embedding(observation, action, following, mask)       # (B, T, .) -> (B, embedding.size)

Step by step, equal to the above (for collectors):

    state = embedding.initial(worlds)                              # (B, embedding.state_size), zeros
    vector, state = embedding.step(embedding.features(observation, action, following), state)
"""

from onlinebayes.embeddings.attention import AttentionEmbedding
from onlinebayes.embeddings.base import Embedding, SetEmbedding, StepwiseEmbedding
from onlinebayes.embeddings.features import RawTransitions, Reference, TransitionFeatures
from onlinebayes.embeddings.filtered import FilteredEmbedding
from onlinebayes.embeddings.gru import GRUEmbedding
from onlinebayes.embeddings.joined import JoinedEmbedding
from onlinebayes.embeddings.kalman import Rows, SimulatorFilter
from onlinebayes.embeddings.likeliest import likeliest
from onlinebayes.embeddings.lstm import LSTMEmbedding
from onlinebayes.embeddings.pooled import PooledEmbedding
from onlinebayes.embeddings.reference import SimulatorReference
from onlinebayes.embeddings.statistics import StatisticsEmbedding
from onlinebayes.embeddings.summary import SummaryEmbedding

__all__ = [
    "AttentionEmbedding",
    "Embedding",
    "FilteredEmbedding",
    "GRUEmbedding",
    "JoinedEmbedding",
    "LSTMEmbedding",
    "PooledEmbedding",
    "RawTransitions",
    "Reference",
    "Rows",
    "SetEmbedding",
    "SimulatorFilter",
    "SimulatorReference",
    "StatisticsEmbedding",
    "StepwiseEmbedding",
    "SummaryEmbedding",
    "TransitionFeatures",
    "likeliest",
]
