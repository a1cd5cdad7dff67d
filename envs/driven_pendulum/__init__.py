"""A driven pendulum: a rig with its own integrator that plays reality, the MJCF an engineer would fit to it, a task."""

from envs.driven_pendulum.rig import MODEL, DrivenPendulumRig
from envs.driven_pendulum.sets import KINDS, Encoder, MeasuredSet, Protocol, blind_set, blind_sets, draw_truth, record
from envs.driven_pendulum.task import BalanceTask

__all__ = [
    "KINDS",
    "MODEL",
    "BalanceTask",
    "DrivenPendulumRig",
    "Encoder",
    "MeasuredSet",
    "Protocol",
    "blind_set",
    "blind_sets",
    "draw_truth",
    "record",
]
