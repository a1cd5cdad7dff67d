"""A Feetech STS3250 that swings a weight; ``rate_limit`` is what its controller does to a goal that moves too fast."""
