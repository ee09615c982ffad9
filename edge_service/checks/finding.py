"""A number held against what it should be, and the usual mistakes of unit and sign, in words."""

import math
import tomllib
from dataclasses import dataclass
from enum import StrEnum
from importlib.resources import files

from ..regression.interval_estimate import IntervalEstimate

FACTOR_TOLERANCE = 0.02
"""No lead, encoder or speed is further off its nominal value than this without a mistake."""
_MISTAKES = tomllib.loads((files(__package__) / "mistakes.toml").read_text("utf-8"))
_KNOWN_FACTORS = {ratio: words for words, ratio in _MISTAKES.items()}
"""Value over truth -> the usual mistake."""


class Verdict(StrEnum):
    FITS = "fits"
    DOUBTFUL = "doubtful"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Finding:
    """Finding of one check."""

    name: str  # of the check
    verdict: Verdict
    sentence: str  # what it found, for people
    figure: IntervalEstimate | None = None  # the number behind it; None where there is none
    expected: float | None = None  # what the machine file says, in the figure's unit
    compared: str = ""  # what was held against what
    remedy: str = ""  # what to do about a doubt
    # no answer can be right while this is so, in a unit or a sign for instance
    forbids: bool = False

    @property
    def is_doubtful(self) -> bool:
        return self.verdict is Verdict.DOUBTFUL


def judge_factor(
    name: str, factor: IntervalEstimate, expected: float, said: str, channel: str = ""
) -> Finding:
    """Hold a factor against what is expected of it."""
    if not factor.determined:
        return Finding(name, Verdict.UNKNOWN, f"cannot tell: {factor.note}", factor, expected)
    low, high = sorted((factor.low / expected, factor.high / expected))
    verdict, sentence = Verdict.FITS, said
    if low > 1.0 + FACTOR_TOLERANCE or high < 1.0 - FACTOR_TOLERANCE:
        verdict, sentence = Verdict.DOUBTFUL, looks_wrong(channel or name, factor.value / expected)
    elif high - low > 2.0 * FACTOR_TOLERANCE:
        verdict, sentence = Verdict.UNKNOWN, "too little motion to tell"
    return Finding(name, verdict, sentence, factor, expected)


def looks_wrong(channel: str, ratio: float) -> str:
    """Value over truth of a channel as a sentence, with the usual mistake that makes it."""
    return f"{channel} looks {wrongly(ratio)}{usual_mistake(abs(ratio), channel)}"


def wrongly(ratio: float) -> str:
    """Value over truth in words."""
    size = abs(ratio)
    inverted = "inverted" if ratio < 0.0 else ""
    if size == 0.0:
        return "still while the axis moves"
    if abs(size - 1.0) <= FACTOR_TOLERANCE:
        return inverted
    words = f"{size:.4g} times too large" if size > 1.0 else f"{1.0 / size:.4g} times too small"
    return f"{inverted} and {words}" if inverted else words


def usual_mistake(ratio: float, what: str) -> str:
    """The usual mistake that makes such a ratio, if there is one."""
    if ratio <= 0.0:
        return ""
    nearest = min(_KNOWN_FACTORS, key=lambda known: abs(math.log(ratio / known)))
    near = abs(math.log(ratio / nearest)) < math.log(1.1)
    return f" ({_KNOWN_FACTORS[nearest]} in {what}?)" if near else ""
