"""Frequency response, and two masses fitted to it."""
