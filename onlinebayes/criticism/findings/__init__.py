"""What is said in the end: the ranking, the answers that are no effect, the notes, what the held-out runs say."""
