"""Windows played through a simulator: time step, hidden states, orientations, parameters that differ or change."""
