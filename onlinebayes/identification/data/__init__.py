"""What was measured, as criticism sees it: runs on an even clock, cut into windows, each with a smoothed start."""
