"""Loggers: a TorchRL logger for Rerun, a run's recording, and its page."""

from onlinebayes.loggers.page import Curves, Page, write_page
from onlinebayes.loggers.recorder import RunRecorder
from onlinebayes.loggers.rerun import RerunLogger

__all__ = ["Curves", "Page", "RerunLogger", "RunRecorder", "write_page"]
