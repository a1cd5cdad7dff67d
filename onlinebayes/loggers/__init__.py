"""Loggers: a TorchRL logger for Rerun, a run's recording, and its page."""

from onlinebayes.loggers.charts import Curves, calibration
from onlinebayes.loggers.page import Film, Page, write_page
from onlinebayes.loggers.recorder import RunRecorder
from onlinebayes.loggers.rerun import RerunLogger
from onlinebayes.loggers.scalars import Loggers, loggers_of, tensorboard

__all__ = [
    "Curves",
    "Film",
    "Loggers",
    "Page",
    "RerunLogger",
    "RunRecorder",
    "calibration",
    "loggers_of",
    "tensorboard",
    "write_page",
]
