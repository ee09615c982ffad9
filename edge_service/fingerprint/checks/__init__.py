"""Checks of a source: signs, units, factors between channels, stuck channels."""
