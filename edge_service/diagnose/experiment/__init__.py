"""Experiments that would decide: what a motion can tell apart, and which is shortest."""
