"""Tests of one axis from recorded traces: what its physics is today, and how sure that is."""
