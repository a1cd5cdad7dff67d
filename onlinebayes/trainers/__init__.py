"""Trainers: the order of the steps, over parts that know no trainer."""

from onlinebayes.trainers.online import OnlineState, OnlineTrainer, Proposal, Record, Schedule, improve
from onlinebayes.trainers.trajectories import HiddenSystem, Policy, RealSystem, returns, trajectories

__all__ = [
    "HiddenSystem",
    "OnlineState",
    "OnlineTrainer",
    "Policy",
    "Proposal",
    "RealSystem",
    "Record",
    "Schedule",
    "improve",
    "returns",
    "trajectories",
]
