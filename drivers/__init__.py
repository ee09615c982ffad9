"""Adapters that read a machine and yield sample frames; one file or folder per protocol."""
