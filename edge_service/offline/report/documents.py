"""Types of the documents of a fingerprint (`fingerprint/1`) and a diagnosis (`diagnosis/1`)."""

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


class Share(Document):
    """A share of the RMS with its 90 % interval."""

    estimate: float
    low: float
    high: float


class ReplayedGap(Document):
    """Measured less simulated, RMS, held-out blocks."""

    before: float
    after: float
    unexplained: float
    shrink: Share


class ChannelGap(Document):
    """RMS of the gap in one channel, in `unit`."""

    before: float
    after: float
    noise_floor: float | None
    floor_source: str | None = None
    tolerance: float | None = None
    unit: str
    replayed: ReplayedGap | None = None


class Place(Document):
    """Interval of a variable in which a gap lives."""

    channel: str
    variable: str
    from_: float = Field(alias="from")
    to: float
    unit: str
    share: float
    energy_share: float


class Parameter(Document):
    """Value of a parameter in `unit`; a bound that the data do not give is null."""

    value: float
    low: float | None
    high: float | None
    unit: str


class NamedEffect(Document):
    """An effect that is part of the cause; `class` cannot be told from it by this data."""

    name: str
    channel: str
    probability: float
    class_: list[str] = Field(alias="class")
    shrink: Share
    replay: Share | None
    parameters: dict[str, Parameter]
    entries: list[dict[str, float]]


class Unexplained(Document):
    """Share of the gap that nothing explains, and the effect that comes nearest."""

    share: float | None
    nearest: str | None


class WaterfallStep(Document):
    """RMS that is left with an effect."""

    effect: str
    rms: float


class Replay(Document):
    """Possibility of simulating the recordings."""

    possible: bool
    reason: str | None


class Suspect(Document):
    """Structure that an effect leaves; null where it cannot be told."""

    structure: float | None


class DiagnosisDocument(Document):
    """Content of diagnosis.json."""

    schema_: Literal["diagnosis/1"] = Field(alias="schema")
    verdict: Literal["no_gap", "explained", "ambiguous", "unknown", "bad_data"]
    gap: dict[str, ChannelGap]
    where: list[Place]
    effects: list[NamedEffect]
    unexplained: Unexplained
    next_motion: str | None
    where_after: list[Place]
    waterfall: dict[str, list[WaterfallStep]]
    not_judged: list[str]
    not_judged_reasons: dict[str, str]
    reasons: list[str]
    withheld: list[str]
    remarks: list[str]
    caveats: list[str]
    replay: Replay
    suspects: dict[str, Suspect]
    reference: list[str] = []
