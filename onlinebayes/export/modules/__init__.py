"""Modules that an export copies beside its worlds.json; each is plain Python that knows nothing of onlinebayes."""
