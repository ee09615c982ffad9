"""Stiffness, lost motion and preload between the two encoders."""
