"""Axes of many services in one table."""
