"""Reply of a receiver, and what it means for an event that was sent."""

from dataclasses import dataclass
from enum import StrEnum


class Outcome(StrEnum):
    """Meaning of an answer."""

    TAKEN = "taken"
    LATER = "later"
    """The receiver is away or busy: it has not judged what was sent."""
    REFUSED = "refused"
    """Another try may help."""
    NEVER = "never"
    """Refusal of an event that was read and will not be taken."""


@dataclass(frozen=True, slots=True)
class Reply:
    """Outcome of a try, and why; the reason holds nothing that the receiver wrote."""

    outcome: Outcome
    reason: str = ""
