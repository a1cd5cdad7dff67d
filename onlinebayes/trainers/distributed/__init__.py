"""Collecting, simulating and studying by many workers, on Ray or here."""

from onlinebayes.trainers.distributed.collecting import MakeEnv, PartedCollector, in_parts
from onlinebayes.trainers.distributed.on_ray import OnRay
from onlinebayes.trainers.distributed.simulating import PartedSimulations
from onlinebayes.trainers.distributed.testing import check_workers
from onlinebayes.trainers.distributed.workers import Here, Station, Workers

__all__ = [
    "Here",
    "MakeEnv",
    "OnRay",
    "PartedCollector",
    "PartedSimulations",
    "Station",
    "Workers",
    "check_workers",
    "in_parts",
]
