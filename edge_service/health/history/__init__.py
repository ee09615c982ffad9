"""Estimates, kept for years: a log that survives a crash, Parquet tiers, one question."""
