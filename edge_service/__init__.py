"""edge-service: how much preload a ball screw has left, how sure that is, and when to doubt it."""

__version__ = "0.1.0"
