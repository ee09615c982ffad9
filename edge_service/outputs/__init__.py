"""Outputs from the bus to systems that people already have."""
