"""Estimation of the named effects: values, intervals, contributions."""
