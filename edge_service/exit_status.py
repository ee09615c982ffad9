"""Exit status of the command, and of what it starts."""

DONE, INTERNAL_FAILURE, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
BAD_DATA = 3
"""Recordings were read, and found unfit for what was asked; the answer says why."""
