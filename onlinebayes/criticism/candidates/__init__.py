"""Which effects are tried where, how far each may go, and all of them screened against the current model."""
