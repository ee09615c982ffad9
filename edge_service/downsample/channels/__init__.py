"""Credibility of the channels: each held against the others, and against its own resolution."""
