"""Measured data as criticism sees them: runs on an even clock, cut into windows, each with a smoothed start."""
