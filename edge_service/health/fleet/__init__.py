"""Axes of many machines: one row each, the worst first; who of many readers reads which of them."""
