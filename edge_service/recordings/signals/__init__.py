"""Recorded signals made fit for analysis: uniform runs, stuck channels, low-pass. Pure."""
