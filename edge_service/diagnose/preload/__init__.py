"""Preload that is lost: what the estimator knows of it, and what it does to a gap."""
