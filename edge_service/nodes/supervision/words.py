"""Errors that nobody foresaw, in one line."""

import traceback


def said(error: BaseException) -> str:
    """Kind, text and place of an error.

    >>> said(ValueError("no number"))
    'ValueError: no number'
    """
    text = " ".join(str(error).split())[:200]
    frames = traceback.extract_tb(error.__traceback__)
    place = f" at {frames[-1].filename.rpartition('/')[2]}:{frames[-1].lineno}" if frames else ""
    return f"{type(error).__name__}{': ' if text else ''}{text}{place}"
