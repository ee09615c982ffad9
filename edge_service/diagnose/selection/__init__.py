"""Selection of causes: noise, candidates, stepwise and exhaustive search, posterior."""
