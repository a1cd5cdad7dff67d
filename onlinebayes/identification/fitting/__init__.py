"""Theta and the windows' starts fitted to convergence; what a fit determines, its time step, the held-out error."""
