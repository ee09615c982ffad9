"""Type of the document that a comparison of moves leaves: `drift/1`."""

from typing import Literal

from pydantic import Field

from ..document import Document


class Change(Document):
    """Against the first recording, with its interval."""

    change: float
    low: float
    high: float
    changed: bool


class Quantity(Document):
    """A quantity of a move, a value per recording; its unit stands in its name."""

    name: str
    values: list[float]
    changes: list[Change]
    changed_since: str | None


class Section(Document):
    """A move that is made in every recording."""

    from_m: float
    to_m: float
    speed_m_s: float
    context: dict[str, float]
    both_ways: bool
    repeats: list[int]
    temperature_c: list[float | None]
    quantities: list[Quantity]


class DriftDocument(Document):
    """Content of drift.json."""

    schema_: Literal["drift/1"] = Field(alias="schema")
    axis: str
    level: float
    recordings: list[str]
    verdict: str
    sections: list[Section]
