"""Type of the document that the account of a real screw leaves: `wear/1`."""

from typing import Literal

from pydantic import Field

from ..document import Document


class Date(Document):
    """A stated date with its band; what has no end within sight is null."""

    earliest_h: float
    likely_h: float | None
    latest_h: float | None


class Stage(Document):
    """Dates stated after one reading, by limit in percent of fresh."""

    time_h: float
    percent: float
    trend: dict[str, Date]
    line: dict[str, Date]


class Crossing(Document):
    """Times at which a limit was crossed; null if never."""

    first_h: float | None
    last_h: float | None


class Tally(Document):
    """Account of the dates; the mean score and the coverage are null where there was no date."""

    asked: int
    stated: int
    held: int
    scores: float | None
    lead_h: dict[str, float]
    said_after: int
    coverage: float | None


class Score(Document):
    """Mean weighted interval score, share of the date; null where none is comparable."""

    trend: float | None
    line: float | None


class WearDocument(Document):
    """Content of wear.json."""

    schema_: Literal["wear/1"] = Field(alias="schema")
    level: float
    fresh_drag_nm: float
    stages: list[Stage]
    crossings: dict[str, Crossing]
    trend: dict[str, Tally]
    line: dict[str, Tally]
    score_where_both_have_a_date: dict[str, Score]
