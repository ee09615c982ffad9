"""Interacting bank of filters: one filter per mode, in several engines."""
