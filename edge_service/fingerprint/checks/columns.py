"""Check that the columns that matter are read: a torque under an unknown header is none."""

import re
from collections.abc import Sequence
from collections.abc import Set as AbstractSet

from ...messages.channels import ANGLE, TABLE_POSITION, TORQUE
from .check_result import CheckResult, Verdict

_TORQUE = re.compile(
    r"torque|trq|moment|current|curr\b|curr[^e]|strom|load|last|force|kraft"
    r"|(?<![a-z])n ?\*?m(?![a-z])|(?<![a-z])m?a(?![a-z])|(?<![a-z])i_?q",
    re.IGNORECASE,
)
"""Words and units of a motor's torque or current, in English and German."""
_SHOWN = 8


def check_columns(channels: AbstractSet[str], unread: Sequence[str]) -> CheckResult:
    """Find a torque that is missing, and the column that may hold it."""
    compared = "headers of the columns against the known channels"
    named = [name for name in unread if name]
    likely = [name for name in named if _TORQUE.search(name)]
    if TORQUE in channels:
        sentence = "torque and position are read" if channels & {ANGLE, TABLE_POSITION} else ""
        sentence = sentence or f"neither {ANGLE} nor {TABLE_POSITION} is read"
        fits = Verdict.FITS if channels & {ANGLE, TABLE_POSITION} else Verdict.DOUBTFUL
        return CheckResult("columns", fits, sentence, compared=compared)
    if likely:
        sentence = f"no column is read as {TORQUE}, though there is {_listed(likely)}"
        remedy = f"add columns.{TORQUE} = {{ column = {likely[0]!r}, scale = ... }}"
    else:
        sentence = f"no column is read as {TORQUE}"
        sentence += f"; not read: {_listed(named)}" if named else ""
        remedy = f"name the column of the torque or current in columns.{TORQUE}"
    return CheckResult(
        "columns",
        Verdict.DOUBTFUL,
        sentence,
        compared=compared,
        remedy=remedy,
        forbids=bool(likely),
    )


def _listed(names: Sequence[str]) -> str:
    more = ", ..." if len(names) > _SHOWN else ""
    return ", ".join(repr(name) for name in names[:_SHOWN]) + more
