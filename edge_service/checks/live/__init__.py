"""Channels of a running axis, each held against the others and against its own resolution."""
