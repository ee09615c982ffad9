"""Trend of the preload, remaining life, and use of the screw."""
