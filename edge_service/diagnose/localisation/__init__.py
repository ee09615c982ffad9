"""Location of the gap: over which variables, in which intervals."""
