"""edge-service: how much preload a ball screw has left, how sure that is, and whether to believe it."""

__version__ = "0.1.0"
