"""Axis condition, component status, and the service state that the HTTP interface reads."""
