"""Bounds of what strangers may ask: bodies, connections, times, descriptors."""
