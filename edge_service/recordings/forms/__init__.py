"""Forms of recordings: one module each, found by themselves."""
