"""Columns that nobody has described: which is which, in which unit, by its name and its motion."""
