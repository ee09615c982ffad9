"""Identification of a healthy, cold axis for the estimator."""
