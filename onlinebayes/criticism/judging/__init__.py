"""May an effect be believed: scores on left-out blocks, the rules of acceptance, one law or a patch, the verdict."""
