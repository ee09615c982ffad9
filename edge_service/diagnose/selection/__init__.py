"""Selection of causes: evidence of a set, stepwise and exhaustive search, posterior."""
