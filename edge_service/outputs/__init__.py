"""Outputs: one file each carries what the topics say to a system of another kind."""
