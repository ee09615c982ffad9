"""Comparison of the same moves over days: what changed beyond the scatter of their repeats."""
