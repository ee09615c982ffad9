"""Alarms that call for a person (after ISA-18.2)."""
