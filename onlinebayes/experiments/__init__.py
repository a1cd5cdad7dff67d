"""Experiments as commands: settings, hidden truths, a run in its folder, exit statuses; what a recipe is made of."""

from onlinebayes.experiments.baselines import baselines
from onlinebayes.experiments.command import STOPPED, ended, settle, status
from onlinebayes.experiments.composition import Run
from onlinebayes.experiments.options import Options
from onlinebayes.experiments.places import closing_line, folder_of, place_of
from onlinebayes.experiments.running import main, run
from onlinebayes.experiments.settings import Kind, Settings, recorded_settings, workers_of
from onlinebayes.experiments.truth import hidden_truth

__all__ = [
    "STOPPED",
    "Kind",
    "Options",
    "Run",
    "Settings",
    "baselines",
    "closing_line",
    "ended",
    "folder_of",
    "hidden_truth",
    "main",
    "place_of",
    "recorded_settings",
    "run",
    "settle",
    "status",
    "workers_of",
]
