"""Residual of a model: its noise floor, the structure in it, and the gap of a healthy machine."""
