"""The findings: the ranking, the answers that are no effect, the notes, the statements of the held-out runs."""
