"""Exit status of the command, and of what it starts."""

DONE, INTERNAL_FAILURE, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
BAD_DATA = 3
"""Recordings were read, and found unfit for what was asked; the answer says why."""


class BadInputError(Exception):
    """Input that a person can mend; the text is one line."""

    status = BAD_INPUT
    document: object = None
    """Members of the JSON answer besides `error`."""
