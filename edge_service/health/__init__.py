"""Axis condition, component status, and the board that the HTTP interface reads."""
