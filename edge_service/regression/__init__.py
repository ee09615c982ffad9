"""Regression: conditioning, linear and nonlinear fits, honest intervals."""
