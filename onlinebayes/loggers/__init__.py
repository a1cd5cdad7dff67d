"""Loggers for training runs, beside TorchRL's own."""

from onlinebayes.loggers.rerun import RerunLogger

__all__ = ["RerunLogger"]
