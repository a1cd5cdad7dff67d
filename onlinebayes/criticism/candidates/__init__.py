"""The effects to try at each target, the range of each, and the screening of all against the current model."""
