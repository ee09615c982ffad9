"""Types of the documents of a fingerprint (`fingerprint/1`)."""

from typing import Literal

from pydantic import Field

from ..document import Document


class Figure(Document):
    """A measured number; without a value it is undetermined, and the note says why."""

    value: float | None
    low: float | None
    high: float | None
    unit: str
    n_effective: float | None
    note: str


class Curve(Document):
    """Values over one another, with their units in the labels."""

    name: str
    x: list[float | None]
    y: list[float | None]
    x_label: str
    y_label: str


class Section(Document):
    """One test of an axis."""

    status: Literal["determined", "undetermined"]
    reason: str
    motion: str
    figures: dict[str, Figure]
    curves: list[Curve]


class Change(Document):
    """A figure against the older fingerprint, in `unit`."""

    figure: str
    old: float
    new: float
    change: float
    low: float
    high: float
    unit: str
    relative: float | None
    sigmas: float
    significant: bool
    material: bool


class FingerprintDocument(Document):
    """Content of fingerprint.json; changes are null without a baseline."""

    schema_: Literal["fingerprint/1"] = Field(alias="schema")
    machine: str
    sources: list[str]
    sections: dict[str, Section]
    changes: list[Change] | None = None
    appeared: list[str] | None = None


class Resonance(Document):
    """A notch and the peak that belongs to it."""

    antiresonance_hz: float
    resonance_hz: float
    height: float


class ResponseDocument(FingerprintDocument):
    """Content of response.json."""

    stated: dict[str, float]
    modes: list[Resonance]
