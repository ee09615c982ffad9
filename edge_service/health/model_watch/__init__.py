"""Consistency of an axis with its model: innovations, friction curve, live values."""
