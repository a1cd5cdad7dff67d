"""Measured machines: model, problem file and what came of it, one folder each; the data lie outside the repository."""

from pathlib import Path

FOLDER = Path(__file__).parent
