"""Fingerprint of an axis: tests with figures and curves, or why there are none; as JSON, and back.

The result is the document: pydantic reads and writes its data classes (schema `fingerprint/1`);
what is not finite is null.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import PlainSerializer, PlainValidator, TypeAdapter

from ..exit_status import BadInputError
from ..messages.samples import Floats
from ..messages.stored import finite_or_none
from ..regression.interval_estimate import IntervalEstimate, normal_quantile, student_quantile

SCHEMA = "fingerprint/1"
SPEED_DIGITS = 2
"""Speeds that agree in so many digits are one speed."""


class FingerprintError(BadInputError):
    """A fingerprint that cannot be made or read; the text is one line."""


Values = Annotated[
    Floats,
    PlainValidator(lambda values: np.asarray(values, np.float64)),
    PlainSerializer(lambda array: [finite_or_none(value) for value in array.tolist()]),
]


class Status(StrEnum):
    """Status of a section: determined by the recordings or not."""

    DETERMINED = "determined"
    UNDETERMINED = "undetermined"


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    name: str
    # x, y: (n,) each, in SI units
    x: Values
    y: Values
    # x_label, y_label: quantity and unit
    x_label: str
    y_label: str


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """One test of the axis."""

    status: Status
    reason: str  # why it is undetermined, one line; empty otherwise
    motion: str  # name of the motion that determines it
    # by name, the unit in the name
    figures: Mapping[str, IntervalEstimate] = field(default_factory=dict)
    curves: tuple[Curve, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class AxisFingerprint:
    """Fingerprint of an axis from the recordings of one session."""

    schema: Literal["fingerprint/1"] = field(default="fingerprint/1", kw_only=True)
    machine: str  # name of the axis
    sources: tuple[str, ...]  # names of the recordings
    sections: Mapping[str, Section]  # by name, in the order of the report

    def figures(self) -> dict[str, IntervalEstimate]:
        """Every figure by `section.name`."""
        return {
            f"{section}.{name}": figure
            for section, content in self.sections.items()
            for name, figure in content.figures.items()
        }


_ADAPTER = TypeAdapter(AxisFingerprint)


def read_fingerprint(path: Path) -> AxisFingerprint:
    """A stored fingerprint. Raises FingerprintError: there is none, or of another schema."""
    try:
        document = json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise FingerprintError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise FingerprintError(f"{path}: not JSON ({error}); expected {SCHEMA}") from error
    found = document.get("schema") if isinstance(document, dict) else None
    if found != SCHEMA:
        raise FingerprintError(f"{path}: schema {found!r}, expected {SCHEMA!r}")
    try:
        return _ADAPTER.validate_python(document)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        words = " ".join(str(error).split())[:200]
        raise FingerprintError(f"{path}: not a complete {SCHEMA} document ({words})") from error


Contents = tuple[Mapping[str, IntervalEstimate], Sequence[Curve]]
"""Figures and curves of a section."""


def examined(motion: str, measure: Callable[[], Contents]) -> Section:
    """The section that `measure` gives; undetermined for its ValueError, or without a number."""
    try:
        figures, curves = measure()
    except ValueError as error:
        return Section(Status.UNDETERMINED, " ".join(str(error).split()), motion)
    if not any(math.isfinite(figure.value) for figure in figures.values()):
        notes = sorted({figure.note for figure in figures.values() if figure.note})
        reason = "; ".join(notes) or "the recordings say nothing about it"
        return Section(Status.UNDETERMINED, reason, motion, figures, tuple(curves))
    return Section(Status.DETERMINED, "", motion, figures, tuple(curves))


def mean_of(
    values: Sequence[float], standard_errors: Sequence[float], unit: str
) -> IntervalEstimate:
    """Mean of repeats: the greater of their scatter and their own errors makes the interval."""
    count = len(values)
    own = math.sqrt(sum(error**2 for error in standard_errors)) / count
    scatter = float(np.std(values, ddof=1)) / math.sqrt(count) if count > 1 else 0.0
    quantile = student_quantile(count - 1) if scatter > own else normal_quantile()
    value, half = float(np.mean(values)), quantile * max(own, scatter)
    return IntervalEstimate(value, value - half, value + half, unit, float(count))


def rounded_rpm(speed_rad_s: float) -> str:
    """Magnitude of a speed in turns per minute with `SPEED_DIGITS` digits, for a name.

    >>> rounded_rpm(-12.5664)
    '120'
    """
    rpm = abs(speed_rad_s) * 60.0 / (2.0 * math.pi)
    digits = SPEED_DIGITS - 1 - math.floor(math.log10(rpm))
    return f"{round(rpm, digits):g}"
