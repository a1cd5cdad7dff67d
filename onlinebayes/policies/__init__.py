"""A trained policy in use: its arrays and its card in a file, its action in numpy alone, its network as ONNX."""

from onlinebayes.policies.acting import NumpyPolicy
from onlinebayes.policies.card import Channel, Channels, Origin, PolicyCard, card_of
from onlinebayes.policies.files import load_policy, read_policy, write_policy
from onlinebayes.policies.network import Layer, Memory, Normalisation, PolicyNetwork
from onlinebayes.policies.onnx import write_onnx

__all__ = [
    "Channel",
    "Channels",
    "Layer",
    "Memory",
    "Normalisation",
    "NumpyPolicy",
    "Origin",
    "PolicyCard",
    "PolicyNetwork",
    "card_of",
    "load_policy",
    "read_policy",
    "write_onnx",
    "write_policy",
]
