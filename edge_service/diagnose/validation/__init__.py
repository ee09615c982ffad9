"""Validation on motion that was not fitted: shrink, misattribution, verdict."""
