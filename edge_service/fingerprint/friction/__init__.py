"""Friction over speed, from cruises."""
