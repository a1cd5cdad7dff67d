"""The search for what is missing: rounds of screening and refits, pairs, families, changes, bounds, ties."""
