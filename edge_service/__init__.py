"""edge-service: how much preload a ball screw has left, how sure that is, and when to doubt it."""

from pathlib import Path

__version__ = "0.1.0"
DEFAULTS = Path(__file__).parent / "defaults"
"""Configuration and machine file where none is named."""
