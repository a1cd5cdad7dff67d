"""Trajectory -> vector: plain masked modules, without knowledge of priors or policies.

    features = TransitionFeatures(observation=4, action=2)
    features.fit(observation, action, following, mask)             # once a round: standardisation
    embedding = LSTMEmbedding(features, hidden=64)
    vector = embedding(observation, action, following, mask)       # (B, T, .) -> (B, embedding.size)

Step by step, equal to the above (for collectors):

    state = embedding.initial(worlds)                              # (B, embedding.state_size), zeros
    vector, state = embedding.step(embedding.features(observation, action, following), state)
"""

from onlinebayes.embeddings.features import Reference, TransitionFeatures
from onlinebayes.embeddings.lstm import LSTMEmbedding

__all__ = ["LSTMEmbedding", "Reference", "TransitionFeatures"]
