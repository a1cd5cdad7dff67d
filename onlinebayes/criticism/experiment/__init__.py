"""The design of the next recording, which decides what a criticism leaves open: see :mod:`.design`."""

from onlinebayes.criticism.experiment.design import next_experiment
from onlinebayes.criticism.experiment.limits import Allowed, Limits, Payload
from onlinebayes.criticism.experiment.plan import Plan, Remedy, Rivalry, Tried

__all__ = ["Allowed", "Limits", "Payload", "Plan", "Remedy", "Rivalry", "Tried", "next_experiment"]
