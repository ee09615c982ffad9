"""Condition of an axis, from preload limits and data faults; status of components."""
