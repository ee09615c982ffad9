"""Identification of a healthy, cold axis: what the estimator needs to know of it."""
