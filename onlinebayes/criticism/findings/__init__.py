"""What is said in the end: the ranking, the answers that are no effect, the notes, the held-out runs opened once."""
