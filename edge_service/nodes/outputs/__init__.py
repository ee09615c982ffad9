"""Outputs of events beside the bus."""
